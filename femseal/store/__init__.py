"""One store: a result is found by a digest of the function of its stage and of its input."""

"""Store results of stages on disk. The key of a result is a digest of the function and the input of its stage."""

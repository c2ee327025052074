"""Results of stages on disk; a digest of the stage's function and input is the key of each."""

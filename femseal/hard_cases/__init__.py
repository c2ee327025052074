"""Hard scenes over the whole chain, each with what must come out: closed forms, bounds and invariants."""

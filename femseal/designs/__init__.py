"""Design answers from a run: what pressures a seal needs in assembly and in service, and what changes them most."""

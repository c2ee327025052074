"""Which files of results a case may choose; a file of its own, so that a case is read without the solvers."""

#: Files for ParaView: series of .vtu, which every ParaView opens, or none.
FORMATS = ("vtu", "none")
#: Default size of the fields of all pixels above which steps are left out [byte], before compression.
FIELDS_LIMIT = 1e9

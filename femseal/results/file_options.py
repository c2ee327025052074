"""Options for the files of results that a case can choose.

They have a module of their own so that a case can be read without importing the solvers.
"""

#: Formats of the files for ParaView: series of .vtu files, which every version of ParaView opens, or no files.
FORMATS = ("vtu", "none")
#: Default limit of the size of all fields over the pixels before compression [byte]. Larger fields are written only at
#: some of the steps.
FIELDS_LIMIT = 1e9

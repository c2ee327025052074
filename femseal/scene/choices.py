"""Options of a scene that are chosen by name.

The names are defined in a separate file, so that a case can be read without importing the solvers.
"""

#: Effect of the fluid pressure on the surfaces: it acts, it acts and trapped liquid keeps its volume, or it is ignored.
FLUID_EFFECTS = ("acts", "trapped", "ignored")
#: Whether contact and fluid together carry the nominal pressure, or the contact alone.
NOMINALS = ("total", "contact")

"""Options of a scene that are chosen by name. They have their own file so that a case is read without the solvers."""

#: Effect of the fluid pressure on the surfaces: it acts, it acts and trapped liquid keeps its volume, or it is ignored.
FLUID_EFFECTS = ("acts", "trapped", "ignored")
#: Whether contact and fluid together carry the nominal pressure, or the contact alone.
NOMINALS = ("total", "contact")

"""What a case and a scene may choose by name; a file of its own, so that a case is read without the solvers."""

#: Whether the fluid presses the faces apart, and liquid in closed pockets keeps its volume; what carries the load.
FLUID_EFFECTS, NOMINALS = ("acts", "trapped", "ignored"), ("total", "contact")
#: Files for ParaView: series of .vtu, which every ParaView opens, or none.
FORMATS = ("vtu", "none")
#: Default size of the fields of all pixels above which steps are left out [byte], before compression.
FIELDS_LIMIT = 1e9

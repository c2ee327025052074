"""What a case and a scene may choose by name; a file of its own, so that a case is read without the solvers."""

#: Whether the fluid presses the faces apart, and liquid in closed pockets keeps its volume; what carries the load.
FLUID_PRESSURES, NOMINALS = ("acts", "trapped", "ignored"), ("total", "contact")
#: Fields for ParaView: the series, which every ParaView opens; VTKHDF for ParaView 5.13 or later; both; or none.
FORMATS = ("vtu", "vtkhdf", "both", "none")
#: Default size of the fields of all pixels above which steps are left out [byte], before compression.
FIELDS_LIMIT = 1e9

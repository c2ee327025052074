"""What a scene may choose by name; a file of its own, so that a case is read without the solvers."""

#: Whether the fluid pressure acts on the surfaces, and liquid in closed pockets keeps its volume.
FLUID_EFFECTS = ("acts", "trapped", "ignored")
#: What carries the nominal pressure: contact and fluid together, or the contact alone.
NOMINALS = ("total", "contact")

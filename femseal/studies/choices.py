"""What a case and a scene may choose by name; a file of its own, so that a case is read without the solvers."""

from ..library.sampling import SAMPLERS

#: Contact of a face as a whole, or of each window under the pressure of a global contact.
CONTACTS = ("whole", "windows")
#: Flow of two scales: links of windows, the whole face, windows condensed to elements.
FLOWS = ("links", "resolved", "elements")
#: Whether the fluid presses the faces apart, and liquid in closed pockets keeps its volume; what carries the load.
FLUID_PRESSURES, NOMINALS = ("acts", "trapped", "ignored"), ("total", "contact")
#: Choices of `Sampling.pressure`: how library windows are loaded.
PRESSURES = ("place", "global", "uniform")
#: Choices of `Sampling.sampler`: those that draw links, and runs of columns.
DRAWS = (*SAMPLERS, "runs")

"""List the studies that a case can choose.

To add a study, write a file with a subclass of `Study`, and enter an instance in `STUDIES`.
"""

from __future__ import annotations

from collections.abc import Collection

from .blocks_type import BLOCKS
from .deterministic_type import DETERMINISTIC
from .stochastic_type import STOCHASTIC
from .study_result import StudyResult
from .study_type import Study
from .two_scale_type import TWO_SCALE

#: All studies by name, in the order in which they are solved. A study can use the results of earlier studies. If a case
#: has several studies, the leakage of the last one is the result of the run.
STUDIES: dict[str, Study] = {
    study.name: study for study in (DETERMINISTIC, TWO_SCALE, BLOCKS, STOCHASTIC)
}
#: Names of all studies, for the choices of a case.
STUDY_NAMES = tuple(STUDIES)
#: Study of a case that names no method, and study of such a case if it describes only a surface.
DEFAULT_STUDY, DEFAULT_OF_SURFACE = STOCHASTIC, DETERMINISTIC


def studies_named(names: Collection[str]) -> list[Study]:
    """Return the studies with the given names, in the order in which they are solved."""
    return [study for study in STUDIES.values() if study.name in names]


def study_of_result(result: StudyResult) -> Study:
    """Return the study by which a result was computed."""
    return STUDIES[result.method]


def names_with(attribute: str, value: bool = True, quote: str = "") -> str:
    """Name all studies with a property for a message, such as "deterministic or two-scale".

    Parameters
    ----------
    attribute : name of a property of `Study` that is True or False.
    value : value of this property.
    quote : character before and after each name.
    """
    studies = [study for study in STUDIES.values() if getattr(study, attribute) is value]
    return " or ".join(f"{quote}{study.name}{quote}" for study in studies)

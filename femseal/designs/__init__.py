"""Design answers from a run: what pressures a seal needs in assembly and in service, and what changes them most."""

from ..base.lazy_package import lazy

__getattr__, __dir__ = lazy(__name__)

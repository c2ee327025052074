"""Find the pressures that a seal needs, and what changes them most."""

from ..base.lazy_package import lazy

__getattr__, __dir__ = lazy(__name__)

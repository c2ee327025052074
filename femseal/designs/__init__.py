"""Find the pressures at which a seal meets a leakage class, and the quantities that change the leakage most."""

from ..base.lazy_package import lazy

__getattr__, __dir__ = lazy(__name__)

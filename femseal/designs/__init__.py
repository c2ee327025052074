"""Find the pressures that a seal needs for a leakage class, and the quantities that change its leakage most."""

from ..base.lazy_package import lazy

__getattr__, __dir__ = lazy(__name__)

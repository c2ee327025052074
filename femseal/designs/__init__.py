"""Design answers from a run: what pressures a seal needs in assembly and in service, and what changes them most."""

from ..base.lazy_package import load_when_used

load_when_used(__name__)

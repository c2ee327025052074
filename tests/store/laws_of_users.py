"""Code of users, which is in no installed package."""

import types


def module_of_user(text, name="laws_of_a_user"):
    """Return a module of a user, whose code is in no installed package."""
    made = types.ModuleType(name)
    exec(compile(text, f"{name}.py", "exec"), vars(made))
    return made


def law_of_user(slope):
    """Return an object of a contact law of a user, whose slope [Pa/m], a text, is in its code."""
    return module_of_user(
        "from dataclasses import dataclass\nimport numpy as np\n"
        "from femseal.contact.law import ContactLaw\n"
        "@dataclass(frozen=True, eq=False)\nclass Own(ContactLaw):\n    hardness: float\n"
        f"    def yield_pressure(self, u=0.0):\n        return self.hardness + {slope} * np.asarray(u)\n"
        f"    def hardening_modulus(self, u=0.0):\n        return np.full(np.shape(u), {slope})\n"
    ).Own(5e8)

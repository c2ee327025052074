"""`python -m femseal`: the command of the environment that this Python is of."""

from .cli import main

if __name__ == "__main__":
    main()

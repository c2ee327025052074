"""Run the command line of femseal by `python -m femseal`, with the interpreter that is called."""

from .cli import main

if __name__ == "__main__":
    main()

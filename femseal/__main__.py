"""Run the command line of femseal in the Python interpreter that is called as `python -m femseal`."""

from .cli import main

if __name__ == "__main__":
    main()

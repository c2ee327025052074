"""Run the femseal command line; this is the entry point for `python -m femseal`."""

from .cli import main

if __name__ == "__main__":
    main()

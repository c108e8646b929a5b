"""What a command prints, on any terminal."""

import io
import sys


def print_any_text() -> None:
    """Lets stdout take every character: one that its encoding lacks is printed as an escape, where the default is an error
    that ends the command."""
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="backslashreplace")

"""``python -m excite``: the command line where no ``excite`` is on the path."""

from excite.cli.main import program

if __name__ == "__main__":
    program()

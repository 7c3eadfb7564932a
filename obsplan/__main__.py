"""``python -m obsplan``."""

from obsplan.cli import main

if __name__ == "__main__":
    main()

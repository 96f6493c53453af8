"""``python -m fapengine``."""

from fapengine.cli import main

if __name__ == "__main__":
    main()

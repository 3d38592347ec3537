"""``python -m continuum_grasp`` is the command line."""

from continuum_grasp.cli import main

if __name__ == "__main__":
    main()

"""`python -m softlab`: the command line."""

from softlab.cli import main

if __name__ == "__main__":
    main()

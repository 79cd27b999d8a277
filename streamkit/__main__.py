"""`python -m streamkit`: the command line, of this interpreter's environment."""

from streamkit.cli.main import main

if __name__ == "__main__":
    main()

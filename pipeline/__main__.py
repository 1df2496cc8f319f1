"""`python -m pipeline` is `vt-pipeline`."""


def main() -> None:
    """Run the command line; worker processes import this module again, and have no use for the rest."""
    from pipeline.cli import app

    app()


if __name__ == "__main__":
    main()

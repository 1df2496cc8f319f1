"""`python -m pipeline` is `vt-pipeline`."""

import gc
import os
import signal


def _end(number: int, _: object) -> None:
    os.write(2, b"error: interrupted\n" if number == signal.SIGINT else b"error: terminated\n")
    os._exit(128 + number)


def main() -> None:
    """Run the command line. It is imported here, because worker processes import this module too, and do not need it.

    Before a command begins, and after its end, Ctrl-C and SIGTERM end this process at once: libraries that are being imported turn an
    exception into others, or into none.
    """
    for number in (signal.SIGINT, signal.SIGTERM):
        if signal.getsignal(number) is not signal.SIG_IGN:  # as nohup and a shell's background jobs ask for
            signal.signal(number, _end)
    gc.set_threshold(10_000, 20, 20)  # imports make a million objects that stay; collections among them took an eighth of `predict`
    from pipeline.cli import app

    app()


if __name__ == "__main__":
    main()

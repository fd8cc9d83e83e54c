"""Flies in other processes and says in the last line what differed; run as ``python -m``, with methods.

With ``fork`` the parent has flown before, its threads included, and child, grandchild and parent all fly on
from there. With ``forkserver`` and ``spawn`` another process flies from the beginning.
"""

import multiprocessing
import sys
import threading
from typing import Any

from tests.processes.flights import FLIGHTS, fly_all

PATIENCE = 150.0  # s that a process may take; more means that it hangs


def compare(found: dict[str, str], right: dict[str, str]) -> None:
    """Say which digests differ."""
    differing = [name for name in right if found.get(name) != right[name]]
    sys.stdout.write(f"{len(right)} flown, differing: {differing}\n")


def child(context: Any, work: Any, *arguments: Any) -> dict[str, str]:
    """What a function gives in a process of its own."""
    receiver, sender = context.Pipe(duplex=False)
    process = context.Process(target=send, args=(sender, work, *arguments))
    process.start()
    sender.close()
    if not receiver.poll(PATIENCE):
        process.kill()
        raise SystemExit(f"a process that {work.__name__} flies in hangs")
    result: dict[str, str] = receiver.recv()
    process.join(PATIENCE)
    if process.exitcode != 0:
        raise SystemExit(f"the process ended with {process.exitcode}")
    return result


def send(sender: Any, work: Any, *arguments: Any) -> None:
    """Run in the process: fly, and send the digests."""
    sender.send(work(*arguments))
    sender.close()


def fork() -> None:
    """Child, grandchild and parent fly on from the same moment."""
    flights = {name: make() for name, make in FLIGHTS.items()}
    for fly in flights.values():
        fly()
    assert threading.active_count() > 1  # the parent has threads that a child has not
    context = multiprocessing.get_context("fork")

    def fly_on() -> dict[str, str]:
        return {name: fly() for name, fly in flights.items()}

    def grandchild_flies_on() -> dict[str, str]:
        grandchild, own = child(context, fly_on), fly_on()
        return own if own == grandchild else {"grandchild": "differs"}

    compare(child(context, grandchild_flies_on), fly_on())


def main(*methods: str) -> None:
    """Compare with what the parent flies."""
    if methods == ("fork",):
        fork()
        return
    right = fly_all()
    for method in methods:
        compare(child(multiprocessing.get_context(method), fly_all), right)


if __name__ == "__main__":
    main(*sys.argv[1:])

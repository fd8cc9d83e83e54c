"""The process behind a window: ``python window_process.py WIDTH HEIGHT TITLE``; see :mod:`.window`.

It says in a line whether the window is open (an empty line) or why not, then shows every picture that comes
by its standard input, and ends with the input or when the user closes the window. It imports nothing of this
package, so that it starts quickly.
"""

import os
import queue
import sys
import threading

os.environ["PYGAME_HIDE_SUPPORT_PROMPT"] = "1"
import pygame

_LISTENING = 0.03
"""Seconds between two looks at what the user does, while no picture comes."""


def main(width: int, height: int, title: str) -> None:
    """Show what comes until it ends."""
    try:
        pygame.display.init()
        pygame.display.set_caption(title)
        window = pygame.display.set_mode((width, height))
    except pygame.error as error:
        _say(str(error))
        return
    _say("")
    pictures: queue.Queue[bytearray | None] = queue.Queue(maxsize=1)
    # Reading blocks, and the window has to answer the user meanwhile.
    threading.Thread(target=_receive, args=(3 * width * height, pictures), daemon=True).start()
    while not any(event.type == pygame.QUIT for event in pygame.event.get()):
        try:
            picture = pictures.get(timeout=_LISTENING)
        except queue.Empty:
            continue
        if picture is None:
            return
        window.blit(pygame.image.frombuffer(picture, (width, height), "RGB"), (0, 0))
        pygame.display.flip()


def _receive(size: int, pictures: "queue.Queue[bytearray | None]") -> None:
    """Pictures from standard input, and None when it ends."""
    with open(0, "rb", buffering=0, closefd=False) as source:
        while True:
            picture = bytearray(size)
            rest = memoryview(picture)
            while rest:
                count = source.readinto(rest)
                if not count:
                    pictures.put(None)
                    return
                rest = rest[count:]
            pictures.put(picture)


def _say(line: str) -> None:
    sys.stdout.write(f"{line}\n")
    sys.stdout.flush()


if __name__ == "__main__":
    main(int(sys.argv[1]), int(sys.argv[2]), sys.argv[3])
    pygame.quit()
    os._exit(0)  # without waiting for the thread that reads

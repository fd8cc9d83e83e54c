"""Speed of environments, of learning in them, of mappers and detectors, beside targets and peers.

``python -m benchmarks`` runs everything in several minutes and writes ``docs/results/speed.md`` and
``speed.png``; ``python -m benchmarks environments`` runs one section and prints it; ``--quick`` only shows
that everything runs.

Every figure is the median of at least five repetitions. What is compared is repeated in turns, so that a
machine whose clock wanders slows all of it alike, and a ratio is the median of the ratios of the rounds.
Compilation and construction are not measured. Sections: :mod:`.environments`, :mod:`.peers`,
:mod:`.learning`, :mod:`.mapping`, :mod:`.detection`, :mod:`.navigation`, :mod:`.formation`.
"""

import os
import signal
import sys

if sys.argv[:1] == ["-m"] and signal.getsignal(signal.SIGINT) is signal.default_int_handler:
    # `python -m benchmarks`: until `run_command`, while the libraries load, Ctrl-C ends it with one line.
    signal.signal(
        signal.SIGINT, lambda *_: (os.write(2, b"\npython -m benchmarks: interrupted\n"), os._exit(130))
    )


from thruster_envs.extras import require

require("bench", "benchmarks")

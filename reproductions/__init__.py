"""Every table and figure of the sources, recomputed: `python -m reproductions list`.

One subpackage for each source, one module for each of its tables, figures or worked examples. A study is a
function that `reproduces` decorates with what the source says, and the command finds it; a family of results
that one function recomputes stands in `REPRODUCTIONS`. What came of it is written to
`docs/results/reproductions.json` and, from that alone, to `docs/results/reproductions.md`. What many studies
draw and write in tables is in `figures` and `cells`.
"""

import os
import signal
import sys

if sys.argv[:1] == ["-m"] and signal.getsignal(signal.SIGINT) is signal.default_int_handler:
    # `python -m reproductions`: until `run_command`, while the libraries load, Ctrl-C ends it with one line.
    signal.signal(
        signal.SIGINT, lambda *_: (os.write(2, b"\npython -m reproductions: interrupted\n"), os._exit(130))
    )


from thruster_envs.extras import require

require("baselines", "reproductions")
require("agents", "reproductions")

from reproductions.record import FULL, QUICK, Effort, Finding, Reproduction, Table, Verdict

__all__ = ["FULL", "QUICK", "Effort", "Finding", "Reproduction", "Table", "Verdict"]

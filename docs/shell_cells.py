"""``%%bash`` for pages: what the commands print comes in one piece, and a command that fails ends the page.

IPython's own hands output on in blocks of a hundred characters, which the page would show with a break between them.
"""

import subprocess


def _bash(_, cell):
    done = subprocess.run(
        ["bash", "-euo", "pipefail", "-c", cell], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    )
    print(done.stdout, end="")
    done.check_returncode()


def load_ipython_extension(shell):
    """Called by %load_ext."""
    shell.register_magic_function(_bash, "cell", "bash")

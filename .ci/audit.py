"""Look up the packages of requirements.lock among the reported holes; where that cannot be done, say why and pass."""

import importlib.util
import subprocess
import sys
from pathlib import Path

LOCK = Path(__file__).resolve().parent.parent / "requirements.lock"
# Seconds for all packages.
PATIENCE = 120
# What pip-audit says where it reaches no index of advisories.
UNREACHED = ("ConnectionError", "Timeout", "Max retries", "ServiceError", "Client Error", "Server Error")
# What it says of a package that the index does not know.
UNKNOWN = "could not be audited"


def main() -> int:
    """The exit status: 1 where a package has a hole."""
    if importlib.util.find_spec("pip_audit") is None:
        print("audit: skipped, pip-audit cannot be installed here")
        return 0
    options = ["--require-hashes", "--disable-pip", "--progress-spinner=off", f"--requirement={LOCK}"]
    call = [sys.executable, "-m", "pip_audit", *options]
    try:
        done = subprocess.run(call, capture_output=True, text=True, timeout=PATIENCE)
    except subprocess.TimeoutExpired:
        print(f"audit: skipped, the index of advisories did not answer within {PATIENCE} s")
        return 0
    packages = sum("==" in line for line in LOCK.read_text(encoding="utf-8").splitlines())
    unknown = (done.stdout + done.stderr).count(UNKNOWN)
    if unknown >= packages or (done.returncode and any(sign in done.stderr for sign in UNREACHED)):
        print("audit: skipped, the index of advisories is out of reach")
        return 0
    lines = [line for line in (done.stdout + done.stderr).splitlines() if UNKNOWN not in line]
    print("\n".join([*lines, f"audit: {packages - unknown} of {packages} packages were looked up"]))
    return done.returncode


if __name__ == "__main__":
    sys.exit(main())

"""Live session with a real record only: a change every 10 ms, printed to the output, until it is killed."""

import sys
import time
from pathlib import Path
from types import SimpleNamespace

from twin_gait.live.session_records import SessionRecorder


def main() -> None:
    recorder = SessionRecorder(
        Path(sys.argv[1]), user="Ann", experiment="fake", document={"duration_s": 1}, folder=Path("run")
    )
    print("session", recorder.session, flush=True)
    began, serial = time.monotonic(), 0
    while True:
        serial += 1
        tick = round(1e3 * (time.monotonic() - began))
        change = SimpleNamespace(
            serial=serial,
            tick=tick,
            response="applied",
            user="Ann",
            subject="belt_speed",
            before=1.5,
            value=1.5 + 0.01 * serial,
            text="belt_speed",
        )
        recorder.event(change)
        if serial % 7 == 0:
            recorder.table({"version": serial}, tick)
        print("change", serial, time.monotonic(), flush=True)
        time.sleep(0.01)


if __name__ == "__main__":
    main()

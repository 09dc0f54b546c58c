#!/usr/bin/env python3
"""Connects a robot, a simulator or a generator to a study of PBPO Studio, and records what it asks.

As a command, which runs another one for each rollout:

    python pbpo_machine.py --url https://studio.example --study my-study --token TOKEN \
        -- python run_robot.py --w0 {w0} --w1 {w1} --out {video}

In that command {video} is the file to write, {seed} the seed of the run, {rollout} its id, and
{NAME} each parameter. Its exit status says what happened: 0 recorded, 3 unsafe (these parameters
must never be run), anything else failed. Of what it prints, the last line of standard error is
sent as the reason; a line "pbpo: progress 0.4" or "pbpo: score 12.5" on standard output is a
report. The token may stand in the variable PBPO_MACHINE_TOKEN instead.

From Python:

    from pbpo_machine import Unsafe, serve

    def record(parameters, video, rollout):
        ...  # run the machine, write the video; raise Unsafe("why") or any other exception
        return {"score": 12.5}  # optional

    serve("https://studio.example", "my-study", token, record)

This file needs Python 3.8 or newer and nothing else.
"""

import argparse
import base64
import hashlib
import http.client
import json
import os
import random
import re
import shlex
import signal
import subprocess
import sys
import tempfile
import threading
import time
import urllib.error
import urllib.parse
import urllib.request
from pathlib import Path

UNSAFE_STATUS = 3
#: Seconds that one call for work waits at the server.
WAIT_S = 25
#: Seconds without an answer after which a call is tried again.
TIMEOUT_S = 60
#: Seconds between two tries: doubled each time, up to the second number.
FIRST_PAUSE_S, LONGEST_PAUSE_S = 0.5, 30.0
#: Seconds that a command has to stop, with what it has started, before it is killed.
ENDING_S = 5
#: Bytes of a video that one request carries.
PIECE = 4 << 20
#: Characters of a reason that the server keeps.
LONGEST_REASON = 2000
_PASSING = (408, 425, 429, 500, 502, 503, 504)
_REPORT = re.compile(r"pbpo: (progress|score) (\S+)\s*")


class Failed(Exception):
    """The machine failed at this rollout. It may be tried again."""


class Unsafe(Exception):
    """These parameters must not be run. They are never proposed again."""


class Lost(Exception):
    """The rollout is not this machine's any more, or the emergency stop was pressed."""


class Refused(Exception):
    """The server refused a call, for a reason that trying again does not change."""

    def __init__(self, status, detail, content):
        super().__init__(detail)
        self.status = status
        self.content = content


class Rollout:
    """One run that the study asks for.

    id, environment, parameters (a dict of numbers), seed, run_index (number of the run of these
    parameters, from 0), attempt, reason ("query", "ahead" or "acquired"), timeout_s.
    """

    def __init__(self, claimed):
        self.id = claimed["id"]
        self.environment = claimed["environment"]
        self.parameters = claimed["parameters"]
        self.seed = claimed["seed"]
        self.run_index = claimed["run_index"]
        self.attempt = claimed["attempt"]
        self.reason = claimed["reason"]
        self.timeout_s = claimed["timeout_s"]
        self.heartbeat_s = claimed["lease"].get("heartbeat_s", 10)
        self._progress = None
        self._lost = None
        self._over = threading.Event()

    def progress(self, share):
        """Tell how far the run is, from 0 to 1; sent with the next heartbeat."""
        self._progress = min(max(float(share), 0.0), 1.0)

    def check(self):
        """Raise Lost if the run should end now. Call it now and then during a long run."""
        if self._lost is not None:
            raise Lost(self._lost)


class Client:
    """The calls of one machine. say: takes a line of text, for the operator."""

    def __init__(self, url, study, token, say=None):
        address = urllib.parse.urlsplit(url)
        if address.scheme not in ("http", "https") or not address.netloc:
            raise ValueError("url: expected an address such as https://studio.example, got %r" % url)
        self._base = "%s/api/v1/studies/%s/rollouts" % (
            url.rstrip("/"),
            urllib.parse.quote(study, safe=""),
        )
        self._token = token
        self.say = say or (lambda _line: None)

    def claim(self, environments=None):
        """The next rollout; None if there is none yet."""
        asked = {"wait_s": WAIT_S}
        if environments:
            asked["environments"] = list(environments)
        claimed = self.call("POST", "/claim", asked)
        return None if claimed is None else Rollout(claimed)

    def heartbeat(self, rollout):
        """Keep the lease. Raises Lost."""
        beat = {"attempt": rollout.attempt}
        if rollout._progress is not None:
            beat["progress"] = rollout._progress
        answer = self.call("POST", "/%s/heartbeat" % rollout.id, beat, tries=1)
        if answer and answer.get("stopped"):
            raise Lost("the emergency stop was pressed")

    def failed(self, rollout, reason, give_back=False):
        """Report that the machine failed; give_back: it was stopped, and the attempt not made."""
        said = {"reason": _short(reason), "attempt": rollout.attempt, "give_back": give_back}
        return self.call("POST", "/%s/failed" % rollout.id, said, tries=3 if give_back else None)

    def unsafe(self, rollout, reason):
        """Report that these parameters must not be run."""
        return self.call("POST", "/%s/unsafe" % rollout.id, {"reason": _short(reason)})

    def measured(self, rollout, score=None, series=None):
        """Send the machine's own numbers on the run: exported, never shown or learnt from."""
        numbers = {"score": score, "series": series, "attempt": rollout.attempt}
        return self.call("POST", "/%s/measurements" % rollout.id, numbers)

    def upload(self, rollout, video):
        """Send the recording, and go on where it was cut. Returns the server's answer."""
        total = os.path.getsize(video)
        with open(video, "rb") as file:
            sha256 = hashlib.sha256()
            for piece in iter(lambda: file.read(1 << 20), b""):
                sha256.update(piece)
            digest = "sha-256=:%s:" % base64.b64encode(sha256.digest()).decode("ascii")
            path = "/%s/recording?attempt=%d" % (rollout.id, rollout.attempt)
            received = 0
            while True:
                file.seek(received)
                data = file.read(min(PIECE, total - received))
                headers = {
                    "Content-Type": "application/octet-stream",
                    "Repr-Digest": digest,
                    "Content-Range": "bytes %d-%d/%d" % (received, received + len(data) - 1, total),
                }
                try:
                    # A piece that was cut off is sent again: the server writes it to its place.
                    answer = self.call("PUT", path, data, headers)
                except Refused as error:
                    # The server has less of it, since another one answers or its disk was emptied.
                    if error.status != 409 or "received" not in error.content:
                        raise
                    received = error.content["received"]
                    continue
                if "received" not in answer:
                    return answer
                received = answer["received"]

    def call(self, method, path, body=None, headers=None, tries=None):
        """The JSON of the answer, or None. Tries again, with growing pauses, what may succeed.

        tries: how often at most; None for as long as it takes. Raises Refused.
        """
        pause = FIRST_PAUSE_S
        tried = 0
        while True:
            tried += 1
            retry_after = None
            try:
                return self._call_once(method, path, body, headers)
            except Refused as error:
                if error.status not in _PASSING or tried == tries:
                    raise
                said = str(error)
                retry_after = error.content.get("retry_after")
            except (OSError, http.client.HTTPException, ValueError) as error:
                if tried == tries:
                    raise
                said = str(error) or type(error).__name__
            if tried == 1 or pause >= LONGEST_PAUSE_S:
                self.say("The studio cannot be reached (%s). Trying again." % said)
            time.sleep(max(retry_after or 0, pause * random.uniform(0.5, 1.0)))  # noqa: S311
            pause = min(2 * pause, LONGEST_PAUSE_S)

    def _call_once(self, method, path, body, headers):
        data = body if isinstance(body, bytes) else json.dumps(body or {}).encode("utf-8")
        asked = urllib.request.Request(self._base + path, data=data, method=method)  # noqa: S310
        asked.add_header("Authorization", "Bearer " + self._token)
        asked.add_header("Accept", "application/json")
        asked.add_header("Content-Type", "application/json")
        for name, value in (headers or {}).items():
            asked.add_header(name, value)
        try:
            with urllib.request.urlopen(asked, timeout=TIMEOUT_S) as answer:  # noqa: S310
                content = answer.read()
                return json.loads(content) if content else None
        except urllib.error.HTTPError as error:
            raise _refusal(error) from None


def serve(url, study, token, record, environments=None, say=None, once=False):
    """Record what the study asks for, until Ctrl+C. Blocks.

    record: called as record(parameters, video, rollout); writes the file `video` (a Path), and
    returns None or a dict with "score" and "series". It raises Unsafe, or any other exception if
    the machine failed. environments: only these. say: takes each line for the operator. once: end
    after one rollout. Raises Refused if the token or the study is not known.
    """
    client = Client(url, study, token, say or (lambda line: print(line, flush=True)))
    client.say("Connected to %s. Waiting for work." % url)
    while True:
        rollout = client.claim(environments)
        if rollout is None:
            continue
        _one(client, rollout, record)
        if once:
            return


def _one(client, rollout, record):
    values = ", ".join("%s = %s" % pair for pair in sorted(rollout.parameters.items()))
    client.say("Rollout %s, attempt %d: %s" % (rollout.id, rollout.attempt, values))
    beats = threading.Thread(target=_keep_alive, args=(client, rollout), daemon=True)
    beats.start()
    try:
        with tempfile.TemporaryDirectory(prefix="pbpo-") as folder:
            _run(client, rollout, record, Path(folder) / "recording.mp4")
    except Lost as error:
        client.say("Given up: %s." % error)
        _quietly(client, lambda: client.failed(rollout, str(error), give_back=True))
    except Refused as error:
        if error.status in (401, 403, 404):
            raise
        client.say("The studio refused it: %s" % error)
    except (KeyboardInterrupt, SystemExit):
        client.say("Stopped. The rollout is given back.")
        _quietly(
            client, lambda: client.failed(rollout, "the machine was stopped", give_back=True)
        )
        raise
    finally:
        rollout._over.set()


def _run(client, rollout, record, video):
    try:
        numbers = record(dict(rollout.parameters), video, rollout)
        rollout.check()
        if not video.is_file() or video.stat().st_size == 0:
            raise Failed("expected a video at %s, and there is none" % video.name)
    except Unsafe as error:
        client.unsafe(rollout, str(error) or "unsafe")
        client.say("Unsafe: %s" % error)
        return
    except (Lost, KeyboardInterrupt, SystemExit):
        raise
    except Exception as error:
        reason = str(error) or type(error).__name__
        client.failed(rollout, reason)
        client.say("Failed: %s" % reason)
        return
    numbers = numbers or {}
    if numbers.get("score") is not None or numbers.get("series") is not None:
        client.measured(rollout, numbers.get("score"), numbers.get("series"))
    answer = client.upload(rollout, video)
    client.say("Recorded." if answer.get("kept", True) else "Not needed any more.")


def _keep_alive(client, rollout):
    """Send heartbeats until the rollout is over; note when it is lost.

    The first one is sent after a second: from then on the server soon misses a machine that died.
    """
    pause = min(1.0, rollout.heartbeat_s)
    while not rollout._over.wait(pause):
        pause = rollout.heartbeat_s
        try:
            client.heartbeat(rollout)
        except Lost as error:
            rollout._lost = str(error)
            return
        except Refused as error:
            if error.status in (401, 404, 409):
                rollout._lost = str(error)
                return
        except Exception:  # noqa: S110
            pass  # the next one may get through


class Command:
    """Runs a command for each rollout: a `record` for `serve`.

    words: the command, with places such as {w0}.
    """

    def __init__(self, words, say=None):
        self._words = list(words)
        self._say = say or (lambda _line: None)

    def __call__(self, parameters, video, rollout):
        known = dict(
            parameters, video=str(video), seed=rollout.seed, rollout=rollout.id,
            environment=rollout.environment, run_index=rollout.run_index,
        )
        words = [_filled(word, known) for word in self._words]
        numbers = {}
        last_error = []
        # In a group of its own: Ctrl+C reaches this program, which then stops the whole group.
        group = {"start_new_session": True} if os.name == "posix" else {}
        try:
            process = subprocess.Popen(
                words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
                errors="replace", **group
            )
        except OSError as error:
            raise Failed("the command cannot be started: %s" % error) from None
        readers = [
            threading.Thread(target=self._read_out, args=(process, rollout, numbers), daemon=True),
            threading.Thread(target=self._read_err, args=(process, last_error), daemon=True),
        ]
        for reader in readers:
            reader.start()
        ends = time.monotonic() + rollout.timeout_s
        try:
            while process.poll() is None:
                rollout.check()
                if time.monotonic() > ends:
                    raise Failed("it took longer than %g seconds" % rollout.timeout_s)
                time.sleep(0.05)
        finally:
            _end(process)
        for reader in readers:
            reader.join(timeout=5)
        if process.returncode == UNSAFE_STATUS:
            raise Unsafe(last_error[-1] if last_error else "unsafe")
        if process.returncode != 0:
            said = last_error[-1] if last_error else "no word on standard error"
            raise Failed("exit status %d: %s" % (process.returncode, said))
        return numbers

    def _read_out(self, process, rollout, numbers):
        for line in process.stdout:
            report = _REPORT.fullmatch(line.strip())
            if report is None:
                self._say(line.rstrip())
                continue
            try:
                value = float(report.group(2))
            except ValueError:
                continue
            if report.group(1) == "progress":
                rollout.progress(value)
            else:
                numbers["score"] = value

    def _read_err(self, process, last_error):
        for line in process.stderr:
            self._say(line.rstrip())
            if line.strip():
                last_error[:] = [line.strip()]


def _filled(word, known):
    """The word with each {NAME} filled in. Raises SystemExit for a name that is not known."""

    def value(place):
        name = place.group(1)
        if name not in known:
            raise SystemExit(
                "expected one of %s in braces, got {%s}" % (", ".join(sorted(known)), name)
            )
        return str(known[name])

    return re.sub(r"\{([A-Za-z_][A-Za-z0-9_]*)\}", value, word)


def _end(process):
    """End the command and what it has started, if it still runs."""
    if process.poll() is not None:
        return
    for number in (signal.SIGTERM, getattr(signal, "SIGKILL", signal.SIGTERM)):
        if os.name == "posix":
            try:
                os.killpg(process.pid, number)
            except ProcessLookupError:
                return
        else:
            process.terminate()
        ends = time.monotonic() + ENDING_S
        while time.monotonic() < ends:
            if process.poll() is not None and not _has_others(process):
                return
            time.sleep(0.05)


def _has_others(process):
    """Whether what the command has started still runs, after the command itself has ended."""
    if os.name != "posix":
        return False
    try:
        os.killpg(process.pid, 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        pass  # there is one, of another user
    return True


def _refusal(error):
    try:
        content = json.loads(error.read() or b"{}")
    except (OSError, ValueError, http.client.HTTPException):
        content = {}
    if not isinstance(content, dict):
        content = {}
    try:
        content["retry_after"] = float(error.headers.get("Retry-After", ""))
    except (TypeError, ValueError):
        pass
    detail = content.get("detail") or content.get("title") or error.reason
    return Refused(error.code, "%s (status %d)" % (detail, error.code), content)


def _short(reason):
    return (str(reason).strip() or "no reason was given")[:LONGEST_REASON]


def _quietly(client, report):
    """Report what the server may not take any more, or not hear."""
    try:
        report()
    except (Refused, OSError, http.client.HTTPException, ValueError) as error:
        client.say("This could not be reported: %s" % error)


def main(arguments=None):
    """The command line. Returns the exit status."""
    given = sys.argv[1:] if arguments is None else list(arguments)
    if "--" in given:
        at = given.index("--")
        given, words = given[:at], given[at + 1 :]
    else:
        words = []
    parser = argparse.ArgumentParser(
        usage="pbpo_machine.py --url URL --study SLUG [--token TOKEN] -- COMMAND ...",
        description="Record the rollouts that a study asks for, by a command that is run for each.",
        epilog="Exit status of COMMAND: 0 recorded, 3 unsafe, anything else failed.",
    )
    parser.add_argument("--url", required=True, help="address of the studio")
    parser.add_argument("--study", required=True, help="the study's slug")
    parser.add_argument("--token", default=os.environ.get("PBPO_MACHINE_TOKEN"),
                        help="the machine's token; default: the variable PBPO_MACHINE_TOKEN")
    parser.add_argument("--environment", action="append", help="only this environment")
    parser.add_argument("--once", action="store_true", help="end after one rollout")
    asked = parser.parse_args(given)
    if not words:
        parser.error("expected the command to run after --, such as -- python run.py --out {video}")
    if not asked.token:
        parser.error("expected --token or the variable PBPO_MACHINE_TOKEN")

    def say(line):
        print(line, flush=True)

    # A stop by a service manager gives the rollout back, as Ctrl+C does.
    signal.signal(signal.SIGTERM, lambda *_: _interrupt())
    say("For each rollout: %s" % " ".join(shlex.quote(word) for word in words))
    try:
        serve(asked.url, asked.study, asked.token, Command(words, say), asked.environment, say,
              asked.once)
    except KeyboardInterrupt:
        return 130
    except Refused as error:
        print("The studio refuses this machine: %s" % error, file=sys.stderr)
        return 2
    except ValueError as error:
        print(error, file=sys.stderr)
        return 2
    return 0


def _interrupt():
    raise KeyboardInterrupt


if __name__ == "__main__":
    sys.exit(main())

"""Jobs in a thread: lines and results come back, and a request to stop is raised once."""

import subprocess
import sys
import threading

import pytest
from walking_study import write_walking

from pdssjax import InputError
from pdssjax.explore.background_job import BackgroundJob, end_jobs


def run(work, during=lambda job: None):
    """The lines of a job, its result and its error."""
    lines, ends, done = [], [], threading.Event()

    def ended(result, error):
        ends.append((result, error))
        done.set()

    job = BackgroundJob(work, lines.append, ended)
    during(job)
    assert done.wait(10)
    job.join(10)
    assert not job.is_running
    ((result, error),) = ends
    return lines, result, error


def test_lines_and_the_result_come_back():
    def work(report):
        report("one")
        report("two")
        return 3

    assert run(work) == (["one", "two"], 3, None)


def test_an_error_comes_back():
    def work(report):
        raise InputError("found none")

    lines, result, error = run(work)
    assert (lines, result) == ([], None)
    assert isinstance(error, InputError)


def test_a_request_to_stop_is_raised_once_at_the_next_line():
    begun, asked = threading.Event(), threading.Event()

    def work(report):
        begun.set()
        assert asked.wait(10)
        with pytest.raises(KeyboardInterrupt):
            report("not told")
        report("putting things in order")
        return "best so far"

    def cancel(job):
        assert begun.wait(10)
        job.cancel()
        asked.set()

    assert run(work, cancel) == (["putting things in order"], "best so far", None)


def test_all_jobs_end_where_the_page_does():
    begun, errors = threading.Event(), []

    def work(report):
        begun.set()
        while True:
            report("still")

    job = BackgroundJob(work, lambda line: None, lambda result, error: errors.append(error))
    assert begun.wait(10)
    assert end_jobs(10)
    assert not job.is_running and isinstance(errors[0], KeyboardInterrupt)


DEAF = """
import threading
import pdssjax.explore as page
from pdssjax.cli import main
from pdssjax.explore.widgets import server
from pdssjax.explore.background_job import BackgroundJob

begun, server.END_TIMEOUT = threading.Event(), 0.1


def serve(bench, port, show, said):
    BackgroundJob(lambda report: begun.set() or threading.Event().wait(), said, lambda *found: None)
    assert begun.wait(10)
    return server.end_jobs(server.END_TIMEOUT)


page.serve = serve
print(main.main(["explore", "study.toml", "--guess", "--no-browser"]))
"""


@pytest.mark.slow
def test_work_that_cannot_be_stopped_does_not_keep_the_command_from_ending_well(tmp_path):
    write_walking(tmp_path)
    ended = subprocess.run([sys.executable, "-c", DEAF], cwd=tmp_path, timeout=120, capture_output=True, text=True)
    assert (ended.returncode, ended.stdout) == (0, ""), ended.stderr

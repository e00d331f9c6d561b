"""What a job says reaches a page that is open, and is dropped of one that is closed."""

import threading
from types import SimpleNamespace

import pytest

pytest.importorskip("panel")
from tornado.ioloop import IOLoop

from pdssjax.explore.widgets.page_thread import PageThread


class Document:
    """In place of a browser's: what is to be done is kept; once it is closed nothing can be added, as in Bokeh."""

    def __init__(self):
        self.session_context = SimpleNamespace(destroyed=False)
        self.kept = []

    def add_next_tick_callback(self, act):
        assert not self.session_context.destroyed
        self.kept.append(act)

    def add_timeout_callback(self, act, milliseconds):
        self.add_next_tick_callback(act)

    def close(self):
        self.session_context.destroyed = True


@pytest.fixture
def document():
    return Document()


@pytest.fixture
def thread(document):
    return PageThread(document)


def settle():
    """Does what the loop has to do."""

    async def nothing():
        pass

    for _ in range(3):
        IOLoop.current().run_sync(nothing)


def act_on(document):
    settle()
    for act in document.kept:
        act()


def test_lines_and_the_end_of_a_job_are_told_in_the_thread_of_the_page(document, thread):
    told, where = [], []

    def work(report):
        report("half")
        return 3

    def ended(result, error):
        told.append((result, error))
        where.append(threading.current_thread())

    thread.start(work, ended, told.append).join(10)
    assert told == []
    act_on(document)
    assert told == ["half", (3, None)]
    assert where == [threading.current_thread()]


def test_what_a_page_is_told_after_it_was_closed_is_dropped(document, thread):
    told = []
    document.close()
    thread.start(lambda report: report("half"), lambda result, error: told.append(error), told.append).join(10)
    thread.later(lambda: told.append("later"))
    thread.after(1, lambda: told.append("after"))
    act_on(document)
    assert told == []
    document.session_context = None  # once Bokeh has forgotten it
    thread.later(lambda: told.append("later"))
    act_on(document)
    assert told == []


def test_the_jobs_of_a_page_that_is_closed_are_stopped(document, thread):
    begun, closed, errors = threading.Event(), threading.Event(), []

    def work(report):
        begun.set()
        assert closed.wait(10)
        try:
            report("not told")
        except KeyboardInterrupt as error:
            errors.append(error)
            raise

    job = thread.start(work, lambda result, error: None)
    assert begun.wait(10)
    thread.cancel_jobs()
    closed.set()
    job.join(10)
    assert len(errors) == 1 and not job.is_running

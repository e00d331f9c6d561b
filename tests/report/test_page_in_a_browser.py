"""A page in a real browser, from the disk: figures are zoomed and moved, nothing fails, nothing is asked for."""

import dataclasses
import re

import fabricated
import pytest
from browser import browsed
from matplotlib.figure import Figure

from pdssjax.report.page import Illustration, Page, Section, Table, write_page


def drawn(count: int) -> Illustration:
    """A figure of one pair of axes, a line across them."""
    figure = Figure(figsize=(7.0, 3.0))
    axes = figure.subplots()
    axes.plot([0.0, 10.0], [0.0, 1.0])
    axes.set(xlim=(0.0, 10.0), ylim=(0.0, 1.0), xlabel="time (s)", ylabel="displacement (µm)")
    return Illustration(figure, f"Motion {count}.")


@pytest.fixture(scope="module")
def address(tmp_path_factory):
    file = tmp_path_factory.mktemp("page") / "page.html"
    table = Table(["parameter", *map(str, range(12))], [[f"piezo.gain <{n}>", *["0.1007063"] * 12] for n in range(4)])
    sections = [
        Section("Records <script>throw 'run'</script>", ["What was measured."], figures=[drawn(1), drawn(2)]),
        Section("Parameters", tables=[table]),
        Section("Notes", points=["A note."], folded=True),
    ]
    write_page(file, Page("Rig <script>throw 'run'</script>", sections))
    return file.as_uri()


@pytest.fixture(scope="module")
def opened(address):
    with browsed(address) as found:
        yield found


@pytest.fixture
def page(opened):
    return opened[0]


def view(figure) -> list[float]:
    """The part of a figure that is shown: left, top, width, height."""
    return [float(number) for number in figure.get_attribute("viewBox").split()]


def test_a_figure_is_zoomed_at_the_pointer_moved_and_shown_whole_again(page):
    figure, other = (page.locator("figure svg").nth(n) for n in range(2))
    figure.scroll_into_view_if_needed()
    whole, box = view(figure), figure.bounding_box()
    x, y = box["x"] + 0.25 * box["width"], box["y"] + 0.5 * box["height"]
    page.mouse.move(x, y)
    page.mouse.wheel(0, -200)
    left, _, width, height = view(figure)
    assert width < 0.7 * whole[2] and height / width == pytest.approx(whole[3] / whole[2])
    # What is below the pointer stays there.
    assert left + 0.25 * width == pytest.approx(0.25 * whole[2], rel=0.01)
    page.mouse.down()
    page.mouse.move(x - 50, y)
    page.mouse.up()
    assert view(figure)[0] == pytest.approx(left + 50 * width / box["width"], rel=0.01)
    page.mouse.dblclick(x, y)
    assert view(figure) == pytest.approx(whole)
    assert view(other) == pytest.approx(whole)


def test_the_page_scrolls_where_there_is_nothing_to_zoom_out_of(page):
    page.evaluate("scrollTo(0, 0)")
    figure = page.locator("figure svg").first
    box, whole = figure.bounding_box(), view(figure)
    page.mouse.move(box["x"] + 100, box["y"] + 100)
    page.mouse.wheel(0, 150)
    for _ in range(100):  # the policy of the page forbids to wait for an expression
        if page.evaluate("scrollY"):
            break
        page.wait_for_timeout(20)
    assert page.evaluate("scrollY") > 0
    assert view(figure) == pytest.approx(whole)


def test_the_keyboard_and_the_buttons_do_the_same(page):
    figure = page.locator("figure svg").first
    whole = view(figure)
    figure.focus()
    page.keyboard.press("+")
    near = view(figure)
    assert near[2] == pytest.approx(0.7 * whole[2])
    page.keyboard.press("ArrowRight")
    assert view(figure)[0] == pytest.approx(near[0] + near[2] / 10)
    page.keyboard.press("0")
    assert view(figure) == pytest.approx(whole)
    for name, width in (("Zoom in", 0.7), ("Zoom out", 1.0), ("Zoom in", 0.7), ("Show the whole figure", 1.0)):
        page.get_by_role("button", name=name).first.click()
        assert view(figure)[2] == pytest.approx(width * whole[2])


def test_the_pointer_says_where_it_is_in_the_units_of_the_axes(page):
    figure, said = page.locator("figure svg").first, page.locator(".tools span").first
    figure.scroll_into_view_if_needed()
    (left, top, right, bottom) = page.evaluate("JSON.parse(document.querySelector('figure svg').dataset.axes)[0].place")
    box = figure.bounding_box()
    at = box["x"] + box["width"] * (left + right) / 2, box["y"] + box["height"] * (top + bottom) / 2
    page.mouse.move(*at)
    time, height = re.findall(r"time \(s\): ([\d.]+), displacement \(µm\): ([\d.]+)", said.inner_text())[0]
    assert float(time) == pytest.approx(5.0, abs=0.05) and float(height) == pytest.approx(0.5, abs=0.01)


def test_a_telephone_shows_all_of_it_without_scrolling_the_page_sideways(page):
    page.set_viewport_size({"width": 375, "height": 700})
    assert page.evaluate("document.scrollingElement.scrollWidth") <= 375
    page.set_viewport_size({"width": 1366, "height": 768})


def test_what_is_folded_is_printed(page):
    page.pdf(format="A4")
    assert page.locator("details[open]").count() == 1


def test_the_page_of_an_identification_opens_without_complaint(page, tmp_path):
    estimate = fabricated.with_errors(fabricated.estimate())
    title = "Rig <img src=x onerror=alert(1)> 'A' & B"
    dataclasses.replace(estimate, title=title, records=estimate.records[1:2]).report(tmp_path / "rig.html")
    opened = page.context.browser.new_page()
    complaints, asked = [], []
    opened.on("console", lambda message: complaints.append(message.text))
    opened.on("pageerror", lambda error: complaints.append(str(error)))
    opened.on("request", lambda request: asked.append(request.url))
    address = (tmp_path / "rig.html").as_uri()
    opened.goto(address)
    assert opened.locator("h1").inner_text() == title
    figure = opened.locator("figure svg").last
    opened.locator("summary").click()
    figure.scroll_into_view_if_needed()
    whole = view(figure)
    figure.hover()
    opened.mouse.wheel(0, -100)
    assert view(figure)[2] < whole[2]
    figure.dblclick()
    assert view(figure) == pytest.approx(whole)
    opened.set_viewport_size({"width": 375, "height": 700})
    assert opened.evaluate("document.scrollingElement.scrollWidth") <= 375
    assert not complaints and asked == [address]
    opened.close()


def test_nothing_failed_and_nothing_was_asked_for(opened):
    page, errors, hosts = opened
    assert errors == []
    assert hosts == {"within the page"}
    assert page.locator("h1").inner_text() == "Rig <script>throw 'run'</script>"

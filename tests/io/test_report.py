"""Reports: what goes in comes out of both files, whole, escaped and self-contained."""

import base64
import math
import re
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote

import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from markdown_it import MarkdownIt
from PIL import Image

from wheelhop.errors import InputError
from wheelhop.io.report import (
    FAILS,
    HOLDS,
    IN_PART,
    OPEN,
    VERDICTS,
    DataTable,
    FigureFile,
    Finding,
    Report,
    Section,
    count_verdicts,
    write_report,
)
from wheelhop.io.report_text import flat, markdown_inline, markdown_paragraph

VOID = {"meta", "br", "img"}
NASTY = (
    "p < 180 & k > 0, \"quoted\" 'single' | f*g* _h_ k_t `i` [j](k) <b>m</b> &amp; "
    "\\| \\ ~~n~~ $o$ #1 {{ x }} {% y %}"
)


class Page(HTMLParser):
    """Elements of a page in order: tag, attributes and text; refuses tags that do not pair."""

    def __init__(self, html):
        super().__init__()
        self.elements, self.open = [], []
        self.feed(html)
        self.close()
        assert not self.open, f"not closed: {self.open}"

    def handle_starttag(self, tag, attrs):
        assert len(dict(attrs)) == len(attrs), f"an attribute of {tag} is given twice"
        if tag == "br":
            self.handle_data("\n")
        element = {"tag": tag, "text": "", **dict(attrs)}
        self.elements.append(element)
        if tag not in VOID:
            self.open.append(element)

    def handle_startendtag(self, tag, attrs):
        assert tag in VOID
        self.handle_starttag(tag, attrs)

    def handle_endtag(self, tag):
        assert self.open, f"</{tag}> closes nothing"
        assert self.open.pop()["tag"] == tag, f"</{tag}> closes another tag"

    def handle_data(self, data):
        for element in self.open:
            element["text"] += data

    def all(self, tag, **attributes):
        return [
            e
            for e in self.elements
            if e["tag"] == tag and all(e.get(k) == v for k, v in attributes.items())
        ]

    def texts(self, *tags):
        return [e["text"].strip() for e in self.elements if e["tag"] in tags]


def finding(verdict=HOLDS, where="Section 5.3, Fig. 6", claim="It converges."):
    return Finding(where, claim, "35 kPa rms.", verdict, "The random walk is slow.")


def rendered(markdown):
    return Page(MarkdownIt("commonmark").enable("table").render(markdown))


def pages(report, directory):
    html, markdown = write_report(report, directory)
    return Page(html.read_text("utf-8")), rendered(markdown.read_text("utf-8"))


@pytest.fixture
def folder(tmp_path):
    """A directory with two figures and a data file, one of them with an awkward name."""
    out = tmp_path / "results"
    (out / "sub").mkdir(parents=True)
    Image.new("RGB", (3, 2), "red").save(out / "plain.png")
    Image.new("RGB", (40, 30), "blue").save(out / "sub" / "fig 6 (B) #1&2_.png")
    (out / "sub" / "fig 6.parquet").write_bytes(b"numbers")
    return out


@pytest.fixture
def report(folder):
    figures = (
        FigureFile(folder / "plain.png", "A red one."),
        FigureFile(
            folder / "sub" / "fig 6 (B) #1&2_.png",
            f"A blue one, {NASTY}",
            folder / "sub" / "fig 6.parquet",
        ),
    )
    table = DataTable("Corner", {"class": ["A", "B"], "c_s [Ns/m]": [2702.3, None]}, "A note.")
    sections = (
        Section("Identification", ("Nine drives.",), (finding(FAILS, "Table 3"),), (table,)),
        Section(
            "Pressure & road",
            ("First.", "Second."),
            [finding(HOLDS, "Fig. 5"), finding(HOLDS, "Fig. 6"), finding(OPEN, "Fig. 7")],
            figures=figures,
        ),
    )
    return Report("A study", ("In short.",), sections, {"command": "wheelhop demo", "runs": 20})


def test_the_html_is_well_formed_and_its_links_lead_somewhere(report, folder):
    page, markdown = pages(report, folder)
    ids = [e["id"] for e in page.elements if "id" in e]
    assert len(set(ids)) == len(ids)
    for shown in (page, markdown):
        anchors = {e["id"] for e in shown.elements if "id" in e}
        links = [e["href"] for e in shown.all("a") if "href" in e]
        assert len(links) >= 7
        for link in links:
            if link.startswith("#"):
                assert link[1:] in anchors
            else:
                assert (folder / unquote(link)).is_file()


def test_figures_are_embedded_in_html_and_linked_in_markdown(report, folder):
    page, markdown = pages(report, folder)
    files = [figure.file for figure in report.sections[1].figures]
    kind = "data:image/png;base64,"
    assert [e["src"][: len(kind)] for e in page.all("img")] == [kind, kind]
    for image, file, size in zip(page.all("img"), files, [("3", "2"), ("40", "30")], strict=True):
        assert base64.b64decode(image["src"][len(kind) :], validate=True) == file.read_bytes()
        assert (image["width"], image["height"]) == size
    assert [folder / unquote(e["src"]) for e in markdown.all("img")] == files
    captions = [figure.caption for figure in report.sections[1].figures]
    for shown in (page, markdown):
        assert [e["alt"] for e in shown.all("img")] == captions
        data = [e["href"] for e in shown.all("a") if e["text"] == "data"]
        assert [folder / unquote(d) for d in data] == [folder / "sub" / "fig 6.parquet"]


def test_the_html_needs_nothing_from_outside(report, folder):
    text = write_report(report, folder)[0].read_text("utf-8")
    page = Page(text)
    assert not page.all("script")
    assert not page.all("link")
    assert not any(name.startswith("on") for e in page.elements for name in e)
    for remote in ("http:", "https:", "//", "url(", "@import"):
        assert remote not in re.sub(r"base64,[A-Za-z0-9+/=]+", "", text), remote
    for element in page.elements:
        assert element.get("src", "data:").startswith("data:")
        assert ":" not in element.get("href", "")


def test_every_finding_stands_in_both_files_on_top_and_in_its_section(report, folder):
    page, markdown = pages(report, folder)
    findings = [f for section in report.sections for f in section.findings]
    for shown in (page, markdown):
        cells = shown.texts("td", "dd", "h3")
        for field in ("where", "claim", "measured"):
            for text in {getattr(f, field) for f in findings}:
                among = sum(getattr(f, field) == text for f in findings)
                assert cells.count(text) == 2 * among, (field, text)
        assert cells.count("The random walk is slow.") == len(findings)
    badges = [e["text"] for e in page.all("span") if e.get("class", "").startswith("verdict")]
    assert badges == [f.verdict for f in findings] * 2
    bold = [text for text in markdown.texts("strong") if text in VERDICTS]
    assert sorted(bold) == sorted(badges)


def test_a_verdict_shows_as_a_word_with_a_colour_of_its_own(folder):
    section = Section("One", (), [finding(verdict) for verdict in VERDICTS])
    page, _ = pages(Report("A study", (), (section,)), folder)
    badges = [e for e in page.all("span") if e.get("class", "").startswith("verdict")]
    assert [e["text"] for e in badges] == [*VERDICTS, *VERDICTS]
    css = page.all("style")[0]["text"]
    colours = [e["class"].split()[1] for e in badges[:4]]
    assert len(set(colours)) == 4
    assert all(f".{colour} {{ color:" in css for colour in colours if colour != "unknown")


def test_verdicts_are_counted(report, folder):
    expected = {HOLDS: 2, IN_PART: 0, FAILS: 1, OPEN: 1}
    assert count_verdicts(report) == expected
    page, markdown = pages(report, folder)
    shown = [" ".join(e["text"].split()) for e in page.all("ul", **{"class": "counts"})]
    assert shown == ["2 holds 0 holds in part 1 does not hold 1 cannot be judged here"]
    cells = markdown.texts("td")
    assert cells[:8] == [text for v, n in expected.items() for text in (v, str(n))]
    for shown in (page, markdown):
        assert "4 claims were checked." in shown.texts("p")


def test_awkward_text_survives_in_every_place(folder):
    lines = f"{NASTY}\nsecond line"
    content = Section(
        NASTY,
        (lines, f"- {NASTY}", f"1. {NASTY}"),
        (Finding(NASTY, lines, lines, HOLDS, lines),),
        (DataTable(NASTY, {NASTY: [lines]}, lines),),
        (FigureFile(folder / "plain.png", lines),),
    )
    report = Report(NASTY, (lines,), (content,), {NASTY: lines})
    page, markdown = pages(report, folder)
    for shown in (page, markdown):
        assert shown.texts("h1") == [NASTY]
        assert NASTY in shown.texts("h2")
        assert shown.texts("a").count(NASTY) == 2
        assert shown.texts("p").count(lines) == 3
        assert {f"- {NASTY}", f"1. {NASTY}"} <= set(shown.texts("p"))
        assert not shown.all("b")
        assert not shown.all("em")
        assert not shown.all("code")
        assert shown.texts("td", "dd").count(lines) == 7
        assert shown.texts("th").count(NASTY) == (2 if shown is page else 1)
        assert shown.all("img")[0]["alt"] == flat(lines)
        assert any(text.startswith(lines) for text in shown.texts("figcaption", "p"))
    assert page.texts("title") == [NASTY]


AWKWARD = st.text(alphabet="ab_1 .)|\\`*<>&;#~$[](!-+=\n\t:'\"", min_size=1).filter(str.strip)


@settings(deadline=None)
@given(AWKWARD)
def test_a_markdown_reader_sees_the_plain_text(text):
    paragraph = rendered(f"{markdown_paragraph(text)}\n")
    cell = rendered(f"| head |\n| --- |\n| {markdown_inline(text)} |\n")
    heading = rendered(f"## {markdown_inline(flat(text))}\n")
    assert {e["tag"] for e in paragraph.elements} <= {"p", "br"}
    assert {e["tag"] for e in heading.elements} == {"h2"}
    seen = [*paragraph.texts("p"), *cell.texts("td"), *heading.texts("h2")]
    assert [" ".join(s.split()) for s in seen] == [" ".join(text.split())] * 3


@pytest.mark.parametrize(
    ("value", "digits", "text"),
    [
        (1.4749, 3, "1.47"),
        (9.999, 3, "10.0"),
        (2702.3, 3, "2702"),
        (-0.012345, 2, "-0.012"),
        (33.5, 4, "33.50"),
        (1.23456e8, 3, "1.23e8"),
        (-1.2e-5, 3, "-1.20e-5"),
        (0.0, 3, "0"),
        (np.float32(0.5), 3, "0.500"),
        (np.float64(80.0), 3, "80.0"),
        (np.int64(1234567), 3, "1234567"),
        (7, 1, "7"),
        (True, 3, "yes"),
        (np.bool_(False), 3, "no"),
        (None, 3, "–"),
        (math.nan, 3, "–"),
        (-math.inf, 3, "-inf"),
        ("2562 +- 20", 3, "2562 +- 20"),
    ],
)
def test_an_entry_reads_well(value, digits, text):
    assert DataTable("T", {"x": [value]}, digits=digits).rows == [[text]]


def test_columns_of_numbers_stand_to_the_right(folder):
    columns = {
        "class": ["A", "B"],
        "jax [m]": jnp.array([1.0, 2.0]),
        "numpy [m]": np.array([1, 2]),
        "gaps [m]": [None, 3.0],
        "mixed": ["none", 3.0],
    }
    table = DataTable("T", columns)
    assert table.numeric == [False, True, True, True, False]
    page, markdown = pages(Report("R", (), (Section("S", tables=(table,)),)), folder)
    assert [e.get("class") for e in page.all("td")[:5]] == [None, *["number"] * 3, None]
    styles = [e.get("style") for e in markdown.all("td")[:5]]
    assert styles == [None, *["text-align:right"] * 3, None]
    for shown in (page, markdown):
        assert shown.texts("td") == [
            "A",
            "1.00",
            "1",
            "–",
            "none",
            "B",
            "2.00",
            "2",
            "3.00",
            "3.00",
        ]


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (
            "wheelhop reproduce --out /home/me/out/brancati -v",
            "wheelhop reproduce --out brancati -v",
        ),
        ("/opt/venv/bin/wheelhop demo --out=/tmp/x/", "wheelhop demo --out=x"),
        ("run '/home/My Name/my out' \"~/a b/c\"", "run 'my out' \"c\""),
        (r"run C:\Users\me\out", "run out"),
        (r"run \\server\share\out.csv", "run out.csv"),
        ("see https://example.org/a/b, <b>no</b>", "see https://example.org/a/b, <b>no</b>"),
        ("at file:///srv/data/road.csv", "at road.csv"),
        ("~/logs/a.csv:/b/c.csv", "a.csv:c.csv"),
        ("demo --out out/brancati ../b ./c", "demo --out out/brancati ../b ./c"),
        ("50 m/s^2, 3 / 4, N/(m/s)", "50 m/s^2, 3 / 4, N/(m/s)"),
        (Path("/home/My Name/out"), "out"),
        (Path("out/brancati"), "out/brancati"),
        ({"jax": "0.10.2", "home": Path("/home/me")}, "jax 0.10.2, home me"),
        ((130, 180.5), "130, 180.5"),
        (83.2171234, "83.2171"),
        (True, "yes"),
    ],
)
def test_what_made_it_is_told_without_absolute_paths(tmp_path, value, text):
    page, markdown = pages(Report("R", (), (), {"setting": value}), tmp_path)
    assert page.texts("td") == [text]
    assert markdown.texts("td") == ["setting", text]


def test_a_report_of_words_alone(tmp_path):
    report = Report("Bare", ("In short.",), (Section("Words", ("No figures.",)),))
    page, markdown = pages(report, tmp_path / "new")
    for shown in (page, markdown):
        assert not shown.all("table")
        assert not shown.all("img")
        assert shown.texts("h1", "h2") == ["Bare", "Words"]
        assert {"In short.", "No figures."} <= set(shown.texts("p"))


def test_a_failing_write_leaves_the_old_files(report, folder, monkeypatch):
    old = [path.read_bytes() for path in write_report(report, folder)]
    before = set(folder.iterdir())

    def refuse(self, target):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "replace", refuse)
    with pytest.raises(InputError, match="No space left"):
        write_report(Report("Another", (), ()), folder)
    assert [(folder / name).read_bytes() for name in ("report.html", "report.md")] == old
    assert set(folder.iterdir()) == before


def test_a_figure_outside_the_directory_is_refused_before_anything_is_written(report, tmp_path):
    with pytest.raises(InputError, match=r"file: .*plain\.png lies outside"):
        write_report(report, tmp_path / "elsewhere")
    assert not list((tmp_path / "elsewhere").iterdir())


def test_the_directory_may_be_given_relative(report, folder, monkeypatch):
    monkeypatch.chdir(folder.parent)
    html, markdown = write_report(report, Path("results"))
    assert (html, markdown) == (Path("results/report.html"), Path("results/report.md"))
    assert "](plain.png)" in markdown.read_text("utf-8")


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda d: finding("perhaps"), r"verdict: 'perhaps' of 'Section 5\.3, Fig\. 6' is unknown"),
        (lambda d: finding(claim=" "), "claim: the text is empty"),
        (lambda d: FigureFile(d / "no.png", "None"), r"file: .*no\.png does not exist"),
        (
            lambda d: FigureFile(d / "plain.png", "Red", d / "no.parquet"),
            r"data: .*no\.parquet does not exist",
        ),
        (lambda d: FigureFile(d / "sub" / "fig 6.parquet", "Data"), r"file: .* is no PNG image"),
        (lambda d: DataTable("T", {"a": [1], "b": [1, 2]}), "columns: the lengths in 'T'"),
        (lambda d: DataTable("T", {}), "columns: the lengths in 'T'"),
        (lambda d: DataTable("T", {"a": [1]}, digits=0), "digits: 0 is below 1"),
        (lambda d: Section("S", "One string."), "text: one string was given"),
        (lambda d: Report("R", "One string.", ()), "summary: one string was given"),
        (lambda d: Section("", ()), "title: the text is empty"),
    ],
)
def test_bad_content_names_its_field(folder, make, message):
    with pytest.raises(InputError, match=message):
        make(folder)

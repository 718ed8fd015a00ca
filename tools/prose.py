#!/usr/bin/env python3
"""Check the prose and the links of documents, and the comments and texts of Rust files.

    python3 tools/prose.py               each finding as FILE:LINE: what: the words; status 1 where there is one
    python3 tools/prose.py FILE ...      those files alone
    python3 tools/prose.py --list        words, sentences, mean sentence and longest paragraph of each file

Documents are README.md, CONTRIBUTING.md, docs/ and the crates' README.md and docs/. Their code blocks, tables, headings and
comments are left out. A code span counts as one word. Texts (help, messages) are string literals of six words or more,
without lines that are set in columns. CONTRIBUTING.md has the rules.
"""

import argparse
import itertools
import math
import pathlib
import re
import sys

# Turns that stop a reader; any case, at any line break.
BANNED = [
    "so many", "one that is none", "that is none", "is none of", "no longer", "an earlier image", "all the same",
    "what is held against", "held against what", "used to be", "not at all", "nothing at all", "as it were",
]
# Turns that a comment may need: "takes no longer than the bus".
FREE_IN_COMMENTS = ["no longer", "not at all"]
LONGEST_PARAGRAPH = 90
LONGEST_SENTENCE = 40
LONGEST_MEAN = {".md": 18, ".rs": 16}
# Fewer sentences than these have no mean to speak of.
FEWEST = {".md": 1, ".rs": 10}

ROOT = pathlib.Path(__file__).resolve().parent.parent
PATTERNS = ["README.md", "CONTRIBUTING.md", "docs/**/*.md", "*/README.md", "*/docs/*.md"]
ITEM = re.compile(r"\s*(?:[-*+]|\d+[.)])\s+")
END = re.compile(r"(?<!e\.g\.)(?<!i\.e\.)(?<=[.!?])[\"')\]]*\s+(?=[\"'(\[]*[^\W_a-z]|[\"'(\[]*`)")
# A comment, a string or a character of a Rust file.
LITERAL = re.compile(r'//[^\n]*|r#".*?"#|"(?:[^"\\]|\\.)*"|\'(?:[^\'\\]|\\.)\'', re.DOTALL)
# What stands for a space and for the end of a sentence within a code span.
HIDDEN = {" ": "\ue000", ".": "\ue001", "!": "\ue002", "?": "\ue003"}


def paragraphs(text):
    """The line and the text of each paragraph and of each list item."""
    text = re.sub(r"<!--.*?-->", lambda found: "\n" * found[0].count("\n"), text, flags=re.DOTALL)
    first, lines, fence = 0, [], ""
    for number, line in enumerate([*text.split("\n"), ""], 1):
        mark = re.match(r"\s*(```+|~~~+)", line)
        if mark and (not fence or mark[1] == fence):
            fence = "" if fence else mark[1]
        aside = mark or fence or not line.strip() or re.match(r"\s*\||#{1,6} |\s*(?:---+|===+)\s*$", line)
        item = ITEM.match(line)
        if lines and (aside or item):
            yield first, "\n".join(lines)
            lines = []
        if not aside:
            first = first if lines else number
            lines.append(line[item.end():] if item else line.lstrip("> "))


def plain(text):
    """Prose without the marks of Markdown, its line breaks kept."""
    text = re.sub(r"`[^`]+`", lambda span: span[0].translate(str.maketrans(HIDDEN)), text)
    text = re.sub(r"!\[[^\]]*\]\([^)]*\)", "", text)
    text = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", text)
    return text.replace("**", "")


def shown(text):
    """Prose as it stands in the file, on one line."""
    for mark, hidden in HIDDEN.items():
        text = text.replace(hidden, mark)
    return " ".join(text.split())


def count(text):
    """Words: what has a letter or a digit."""
    return sum(any(sign.isalnum() for sign in word) for word in text.split())


def sentences(text):
    """The offset and the text of each sentence."""
    ends = [0, *(found.end() for found in END.finditer(text)), len(text)]
    pieces = [(start, text[start:end]) for start, end in zip(ends, ends[1:])]
    return [(start, piece) for start, piece in pieces if count(piece)]


def comments(text):
    """The comments of a Rust file, each in its line."""
    lines = (re.match(r"\s*//[/!]? ?(.*)", line) for line in text.split("\n"))
    return "\n".join(line[1] if line else "" for line in lines)


def texts(text):
    """The line and the paragraphs of each string literal of a Rust file."""
    for literal in LITERAL.finditer(text):
        if literal[0].startswith('"') and count(literal[0]) >= 6 and re.search("[a-z]{4}", literal[0]):
            said = re.sub(r"\\\n\s*", "", literal[0][1:-1]).replace("\\n", "\n")
            said = "\n".join("" if re.search(r"^ |\S {2,}\S", line) else line for line in said.split("\n"))
            for paragraph in said.split("\n\n"):
                yield text.count("\n", 0, literal.start()) + 1, paragraph


def read(path):
    """The figures of a file, and its findings as line and words."""
    found, lengths, longest = [], [], 0
    written, banned = path.read_text(encoding="utf-8"), BANNED
    pieces = paragraphs(written)
    if path.suffix == ".rs":
        pieces = itertools.chain(paragraphs(comments(written)), texts(written))
        banned = [turn for turn in BANNED if turn not in FREE_IN_COMMENTS]
    for first, raw in pieces:
        text = plain(raw)
        words = count(text)
        longest = max(longest, words)
        if words > LONGEST_PARAGRAPH:
            found.append((first, f"{words} words in a paragraph: {shown(text)[:100]} ..."))
        for start, sentence in sentences(text):
            lengths.append(count(sentence))
            if lengths[-1] > LONGEST_SENTENCE:
                line = first + text.count("\n", 0, start)
                found.append((line, f"{lengths[-1]} words in a sentence: {shown(sentence)}"))
        for turn in banned:
            for match in re.finditer(rf"\b{turn}\b".replace(" ", r"\s+"), text, re.IGNORECASE):
                line = first + text.count("\n", 0, match.start())
                words_around = shown(text[max(0, match.start() - 40):match.end() + 40])
                found.append((line, f"`{turn}`: ... {words_around} ..."))
    mean = sum(lengths) / len(lengths) if lengths else 0
    most = LONGEST_MEAN.get(path.suffix, math.inf)
    if mean > most and len(lengths) >= FEWEST[path.suffix]:
        found.append((1, f"a mean sentence of {mean:.1f} words; {most} are allowed"))
    return (sum(lengths), len(lengths), mean, longest), sorted(found)


def anchor(heading):
    """The name by which a link finds a heading."""
    return re.sub(r"[^\w\- ]", "", shown(plain(heading)).replace("`", "").lower()).replace(" ", "-")


def broken_links(path):
    """Links to a file or a heading that is not there, as line and words."""
    for number, line in enumerate(path.read_text(encoding="utf-8").split("\n"), 1):
        for file, heading in re.findall(r"\]\((?![a-z]+:)([^)#\s]*)#?([^)\s]*)\)", line):
            target = path.parent / file if file else path
            headings = []
            if heading and target.suffix == ".md" and target.exists():
                headings = re.findall(r"^#+ +(.+)$", target.read_text(encoding="utf-8"), re.MULTILINE)
            if not target.exists() or (headings and heading not in map(anchor, headings)):
                yield number, f"a link to nothing: {file}{'#' if heading else ''}{heading}"


def sources():
    """Rust files whose comments are checked."""
    folders = [folder for folder in sorted(ROOT.iterdir()) if folder.is_dir() and folder.name != "target"]
    return [ROOT / "build.rs"] + [path for folder in folders for path in sorted(folder.rglob("*.rs"))]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("files", nargs="*", type=pathlib.Path, metavar="FILE")
    parser.add_argument("--list", action="store_true", help="the figures of each file")
    options = parser.parse_args()
    paths = options.files or [path for pattern in PATTERNS for path in sorted(ROOT.glob(pattern))] + sources()
    if options.list:
        print(f"{'':<28} {'words':>6} {'sentences':>9} {'mean':>5} {'longest paragraph':>17}")
    bad = 0
    for path in paths:
        path = path.resolve()
        name = str(path.relative_to(ROOT)) if path.is_relative_to(ROOT) else str(path)
        (words, number, mean, longest), found = read(path)
        if path.suffix == ".md":
            found.extend(broken_links(path))
        if options.list:
            print(f"{name:<28} {words:>6} {number:>9} {mean:>5.1f} {longest:>17}")
        else:
            bad += len(found)
            print(*(f"{name}:{line}: {what}\n" for line, what in found), sep="", end="")
    sys.exit(bool(bad))


if __name__ == "__main__":
    main()

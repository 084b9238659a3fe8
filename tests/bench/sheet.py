#!/usr/bin/env python3
"""One picture of many: a row for each scene, a column for each method, with its name, after renders that equal_time.py has kept.

    pip install numpy OpenEXR pillow
    python3 tests/bench/sheet.py KEPT OUT.png --methods none,ppg,neural --show SCENE_FOLDER[:X,Y,W,H]...

KEPT has SCENE-METHOD.exr; the last column is the folder's reference.exr. The part of a picture that is shown is given in pixels; all of
it if none is given. Parts are made as high as the highest, with pixels as they are.
"""

import argparse
import pathlib

from figures import developed, side_by_side
from PIL import Image, ImageDraw

TITLE = 14


def titled(text, width):
    picture = Image.new("RGB", (width, TITLE), "white")
    ImageDraw.Draw(picture).text((2, 1), text, fill="black")
    return picture


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("kept", type=pathlib.Path)
    parser.add_argument("out", type=pathlib.Path)
    parser.add_argument("--methods", required=True)
    parser.add_argument("--show", action="append", required=True, metavar="FOLDER[:X,Y,W,H]")
    args = parser.parse_args()
    methods, rows = args.methods.split(","), []
    for shown in args.show:
        folder, _, part = shown.partition(":")
        folder = pathlib.Path(folder)
        files = [args.kept / f"{folder.name}-{method}.exr" for method in methods] + [folder / "reference.exr"]
        row = [developed(file) for file in files]
        if part:
            x, y, width, height = map(int, part.split(","))
            row = [picture.crop((x, y, x + width, y + height)) for picture in row]
        rows.append(row)
    highest = max(row[0].height for row in rows)
    rows = [[picture.resize((round(picture.width * highest / picture.height), highest), Image.Resampling.NEAREST) for picture in row] for row in rows]
    widths = [max(picture.width for picture in column) for column in zip(*rows)]
    titles = [titled(text, width) for text, width in zip([*methods, "reference"], widths)]
    side_by_side([titles, *rows]).save(args.out, optimize=True)


if __name__ == "__main__":
    main()

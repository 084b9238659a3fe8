"""Blender's images: what they hold, and how they come into the exported folder."""

import os
import re

import bpy
import numpy as np

from . import files
from .fields import srgb_to_linear

# Colour spaces in which bytes are what fanal takes pictures for unless they are `raw`.
_SRGB = {"sRGB"}
# Colour spaces in which values are used as they are.
_PLAIN = {"Non-Color", "Raw", "Linear", "Linear Rec.709", "Generic Data"}


class Source:
    """A picture file that can be used as it is."""

    def __init__(self, image, data, ending, raw):
        self.image, self.data, self.ending, self.raw = image, data, ending, raw


class Pictures:
    """Writes pictures into `textures/` of a folder, each once."""

    def __init__(self, folder, warn):
        self.folder, self.warn = folder, warn
        self._names, self._stored, self._pixels = set(), {}, {}

    def pixels(self, image):
        """Linear values, rows from the top, four channels, colours not multiplied by alpha; None where there is no picture."""
        key = image.as_pointer()
        if key not in self._pixels:
            self._pixels[key] = self._load(image)
        return self._pixels[key]

    def _load(self, image):
        width, height = image.size
        if width * height == 0 or not image.has_data and image.source != "GENERATED" and not len(image.pixels):
            self.warn(f"image “{image.name}” has no pixels: 0.5 stands for it")
            return None
        values = np.empty(width * height * image.channels, np.float32)
        image.pixels.foreach_get(values)
        values = values.reshape(height, width, image.channels)[::-1]
        if image.channels == 1:
            values = np.repeat(values, 3, axis=2)
        alpha = values[:, :, 3:4] if image.channels == 4 else np.ones((height, width, 1), np.float32)
        color = values[:, :, :3] if values.shape[2] >= 3 else np.repeat(values[:, :, :1], 3, axis=2)
        space = image.colorspace_settings.name
        if image.is_float:
            # Blender has converted them to linear, multiplied by alpha.
            if image.alpha_mode in ("STRAIGHT", "PREMUL"):
                color = np.divide(color, alpha, out=np.array(color), where=alpha > 0)
        elif space in _SRGB:
            color = srgb_to_linear(color)
        elif space not in _PLAIN:
            self.warn(f"image “{image.name}”: colour space {space} is taken for sRGB")
            color = srgb_to_linear(color)
        return np.ascontiguousarray(np.concatenate([color, alpha], axis=2), np.float32)

    def has_alpha(self, image):
        """Whether the picture has holes."""
        if image.channels != 4 or image.alpha_mode in ("NONE", "CHANNEL_PACKED"):
            return False
        pixels = self.pixels(image)
        return pixels is not None and bool((pixels[:, :, 3] < 1.0).any())

    def source(self, image):
        """The picture's file, if fanal can read it and takes it for the same colours; otherwise None."""
        if image.source != "FILE" or image.is_dirty or image.type == "MULTILAYER":
            return None
        if image.packed_file:
            data = image.packed_file.data
        else:
            try:
                with open(bpy.path.abspath(image.filepath, library=image.library), "rb") as file:
                    data = file.read()
            except OSError:
                return None
        ending = files.picture_kind(data)
        if ending is None and image.file_format in ("TARGA", "TARGA_RAW"):
            ending = ".tga"
        space = image.colorspace_settings.name
        if ending in (".exr", ".hdr"):
            fits = space in _PLAIN and (ending == ".hdr" or files.is_plain_exr(data))
            return Source(image, data, ending, True) if fits else None
        if ending is None or space not in _SRGB | _PLAIN:
            return None
        return Source(image, data, ending, space in _PLAIN)

    def store_source(self, source):
        """Path, relative to the scene, of the picture's file."""
        key = ("file", source.image.as_pointer())
        if key not in self._stored:
            self._stored[key] = self._write(source.image.name, source.ending, source.data)
        return self._stored[key]

    def store_field(self, field, name, half=True):
        """Path, relative to the scene, of a new picture of the field's values, which is `raw`."""
        key = ("field", id(field))
        if key not in self._stored:
            # The field is kept, so that its id is not given to another.
            self._stored[key] = (self._write(name, ".exr", files.exr(field.data, half)), field)
        return self._stored[key][0]

    def _write(self, name, ending, data):
        stem = re.sub(r"[^A-Za-z0-9_.-]+", "_", os.path.splitext(name)[0])[:60].strip("._") or "picture"
        unique, count = stem, 1
        while unique.lower() in self._names:
            count += 1
            unique = f"{stem}-{count}"
        self._names.add(unique.lower())
        folder = os.path.join(self.folder, "textures")
        os.makedirs(folder, exist_ok=True)
        files.write_bytes(os.path.join(folder, unique + ending), data)
        return f"textures/{unique}{ending}"

"""Shader nodes that compute colours and numbers, evaluated as fields: constants stay constants, pictures become pictures."""

import numpy as np
from mathutils import Euler, Matrix, Vector

from .arithmetic import MATH, blended, from_hsv, safe_divide, to_hsv
from .fields import Field, Lookup, combine, with_matrix

# Steps in which ramps and curves are tabulated.
_STEPS = 256
# About the mean of procedural textures' factors.
_HALF = {"ShaderNodeTexNoise", "ShaderNodeTexVoronoi", "ShaderNodeTexWave", "ShaderNodeTexMagic", "ShaderNodeTexGradient",
         "ShaderNodeTexWhiteNoise", "ShaderNodeTexGabor", "ShaderNodeTexBrick"}


class Place:
    """A node tree, and the group node through which one came into it."""

    def __init__(self, tree, group=None, outer=None):
        self.tree, self.group, self.outer = tree, group, outer
        # All the group nodes on the way: one within a group that is used twice is in two places.
        self.chain = () if group is None else (*outer.chain, group.as_pointer())


def source_of(socket, place):
    """The output socket that feeds an input and its place, through reroutes and groups; (None, default) where nothing does: the
    second is then the input socket whose default value counts."""
    while True:
        link = next((link for link in socket.links if link.is_valid and not link.is_muted), None)
        if link is None:
            return None, socket
        output, node = link.from_socket, link.from_node
        while node.mute:
            inner = next((inside for inside in node.internal_links if inside.to_socket == output), None)
            link = inner and next(iter(inner.from_socket.links), None)
            if link is None:
                return None, inner.from_socket if inner else socket
            output, node = link.from_socket, link.from_node
        if node.bl_idname == "NodeReroute":
            socket = node.inputs[0]
        elif node.bl_idname == "NodeGroupInput" and place.group is not None:
            socket = next(item for item in place.group.inputs if item.identifier == output.identifier)
            place = place.outer
        elif node.bl_idname == "ShaderNodeGroup" and node.node_tree is not None:
            inner = next((item for item in node.node_tree.nodes
                          if item.bl_idname == "NodeGroupOutput" and item.is_active_output), None)
            if inner is None:
                return None, socket
            place = Place(node.node_tree, node, place)
            socket = next(item for item in inner.inputs if item.identifier == output.identifier)
        else:
            return output, place


def named(node, name):
    """The enabled input of that name or identifier."""
    for socket in node.inputs:
        if socket.identifier == name:
            return socket
    return next((socket for socket in node.inputs if socket.name == name and socket.enabled), None)


class Evaluator:
    """Evaluates sockets of one tree. `warn` gets messages, `pictures` holds images."""

    def __init__(self, pictures, warn):
        self.pictures, self.warn = pictures, warn
        self._known = {}
        # What numbers count as that are not evaluated; None is their output's own value.
        self._unknown = None

    def input(self, node, name, place):
        """The field of a node's input. In a strength numbers that are not evaluated count as 1, since 0 would put out the light."""
        before = self._unknown
        if name.endswith("Strength"):
            self._unknown = 1.0
        field = self.socket(named(node, name), place)
        self._unknown = before
        return field

    def socket(self, socket, place):
        """The field that an input socket gets, of as many channels as its type has."""
        output, other = source_of(socket, place)
        if output is None:
            value = getattr(other, "default_value", 0.0)
            field = Field.constant(value if hasattr(value, "__len__") else float(value))
        else:
            field = self._output(output, other)
        if socket.type in ("VALUE", "INT", "BOOLEAN"):
            return field.as_number()
        return field.as_color()

    def number(self, node, name, place):
        """One number for an input: the mean where it varies, with a warning."""
        field = self.input(node, name, place)
        if not field.is_constant:
            self.warn(f"node “{node.name}”: the mean of {name} is used, which varies")
        return field.number()

    def _output(self, output, place):
        key = (output.node.as_pointer(), output.identifier, place.chain, self._unknown)
        if key not in self._known:
            self._known[key] = self._compute(output.node, output, place)
        return self._known[key]

    def _lost(self, node):
        return lambda _: self.warn(
            f"node “{node.name}”: two pictures with other texture coordinates or edges: the mean of the smaller is used")

    def _compute(self, node, output, place):
        function = _NODES.get(node.bl_idname)
        if function is None:
            return self._guess(node, output)
        return function(self, node, output, place)

    def _guess(self, node, output):
        if node.bl_idname in _HALF:
            value = 0.5
        elif output.type in ("VALUE", "INT", "BOOLEAN"):
            value = getattr(output, "default_value", 0.0) if self._unknown is None else self._unknown
        else:
            value = 0.5
        self.warn(f"node “{node.name}” ({node.bl_label}) is not evaluated: {value:g} stands for “{output.name}”")
        return Field.constant(value if output.type in ("VALUE", "INT", "BOOLEAN") else [value] * 3)

    # Texture coordinates.

    def lookup(self, node, place, wrap="repeat", filter="bilinear", usual=("uv", "")):
        """How a texture node looks up its picture; `usual` are the coordinates that it has where none are given."""
        socket = named(node, "Vector")
        kind, matrix = self._coordinates(socket, place, usual) if socket else (usual, Matrix.Identity(4))
        mapping = getattr(node, "texture_mapping", None)
        if mapping is not None and mapping.rotation[:] + mapping.translation[:] + mapping.scale[:] != (0, 0, 0) * 2 + (1, 1, 1):
            matrix = Matrix.LocRotScale(mapping.translation, Euler(mapping.rotation), mapping.scale) @ matrix
        rows = [list(matrix[0]), list(matrix[1])]
        if kind[0] == "uv":
            return Lookup(kind, tuple(row[i] for row in rows for i in (0, 1, 3)), wrap, filter)
        if rows[0][2] == rows[1][2] == 0.0:
            projection = ((1.0, 0.0, 0.0, 0.0), (0.0, 1.0, 0.0, 0.0))
            return Lookup((kind[0], projection), tuple(row[i] for row in rows for i in (0, 1, 3)), wrap, filter)
        return Lookup((kind[0], tuple(tuple(row) for row in rows)), wrap=wrap, filter=filter)

    def _coordinates(self, socket, place, usual=("uv", "")):
        output, other = source_of(socket, place)
        if output is None:
            return usual, Matrix.Identity(4)
        node = output.node
        if node.bl_idname == "ShaderNodeUVMap":
            return ("uv", node.uv_map), Matrix.Identity(4)
        if node.bl_idname == "ShaderNodeTexCoord":
            if output.name == "Object" and node.object is not None:
                self.warn(f"node “{node.name}”: coordinates of another object are taken for the object's own")
            if output.name in ("UV", "Generated", "Object"):
                return (("uv", "") if output.name == "UV" else (output.name.lower(),)), Matrix.Identity(4)
        if node.bl_idname == "ShaderNodeAttribute" and output.name == "Vector":
            return ("uv", node.attribute_name), Matrix.Identity(4)
        if node.bl_idname == "ShaderNodeMapping":
            kind, matrix = self._coordinates(named(node, "Vector"), other)
            return kind, self.mapping(node, other) @ matrix
        self.warn(f"node “{node.name}” ({node.bl_label}): its texture coordinates are not evaluated: UV stands for them")
        return ("uv", ""), Matrix.Identity(4)

    def mapping(self, node, place):
        """The matrix of a Mapping node."""
        def vector(name):
            socket = named(node, name)
            return Vector(self.socket(socket, place).mean()) if socket else Vector((0, 0, 0))

        location, rotation, scale = vector("Location"), Euler(vector("Rotation")), vector("Scale")
        if node.vector_type == "TEXTURE":
            safe = Vector([x or 1.0 for x in scale])
            return Matrix.LocRotScale(location, rotation, safe).inverted()
        if node.vector_type == "POINT":
            return Matrix.LocRotScale(location, rotation, scale)
        if node.vector_type == "NORMAL":
            safe = Vector([1.0 / (x or 1.0) for x in scale])
            return Matrix.LocRotScale(Vector((0, 0, 0)), rotation, safe)
        return Matrix.LocRotScale(Vector((0, 0, 0)), rotation, scale)


def _image(self, node, output, place):
    image = node.image
    if image is None:
        # Cycles shows missing pictures in pink.
        self.warn(f"node “{node.name}” has no image")
        return Field.constant([1.0, 0.0, 1.0] if output.name == "Color" else 1.0)
    if image.source in ("TILED", "SEQUENCE", "MOVIE"):
        self.warn(f"image “{image.name}”: only one picture of it is used ({image.source.lower()})")
    if node.projection != "FLAT":
        self.warn(f"node “{node.name}”: projection {node.projection.lower()} is taken for flat")
    if node.interpolation in ("Cubic", "Smart"):
        self.warn(f"node “{node.name}”: interpolation is bilinear, not {node.interpolation.lower()}")
    wraps = {"REPEAT": "repeat", "EXTEND": "clamp", "CLIP": "clamp", "MIRROR": "mirror"}
    if node.extension == "CLIP":
        self.warn(f"node “{node.name}”: beyond the picture its edge goes on, not black")
    lookup = self.lookup(node, place, wraps[node.extension], "nearest" if node.interpolation == "Closest" else "bilinear")
    pixels = lambda: self.pictures.pixels(image)
    if image.size[0] * image.size[1] == 0 or pixels_missing(image):
        self.warn(f"image “{image.name}” cannot be read")
        return Field.constant([1.0, 0.0, 1.0] if output.name == "Color" else 1.0)
    if output.name == "Alpha":
        if not self.pictures.has_alpha(image):
            return Field.constant(1.0)
        return Field(lambda: pixels()[:, :, 3:4], lookup)
    source = self.pictures.source(image)
    if self.pictures.has_alpha(image):
        straight = any(socket.is_linked for socket in node.outputs if socket.name == "Alpha")
        if not straight and image.colorspace_settings.name != "Non-Color":
            # Cycles multiplies colours by alpha unless something asks for alpha.
            return Field(lambda: pixels()[:, :, :3] * pixels()[:, :, 3:4], lookup)
    return Field(lambda: pixels()[:, :, :3], lookup, source)


def pixels_missing(image):
    """Whether there is nothing to read of an image."""
    return image.source == "FILE" and not image.packed_file and not image.has_data and len(image.pixels) == 0


def _checker(self, node, output, place):
    one, two = self.input(node, "Color1", place), self.input(node, "Color2", place)
    scale = self.number(node, "Scale", place)
    # Of all textures only pictures have UV coordinates where none are given.
    lookup = self.lookup(node, place, filter="nearest", usual=("generated",))
    if not (one.is_constant and two.is_constant):
        self.warn(f"node “{node.name}”: the means of its colours are used, which vary")
    if lookup.coordinates[0] != "uv":
        self.warn(f"node “{node.name}”: the checkerboard has two dimensions, not three")
    # Two squares to a period. Where both indices are even or both odd the second colour is seen.
    matrix = np.array(lookup.matrix).reshape(2, 3) * (0.5 * scale)
    one, two = (field.as_color().mean() for field in (one, two))
    if output.name == "Fac":
        one, two = [1.0], [0.0]
    return Field(np.array([[one, two], [two, one]], np.float32), with_matrix(lookup, matrix))


def _mix(self, node, output, place):
    data = getattr(node, "data_type", "RGBA")
    if data == "ROTATION":
        return self._guess(node, output)
    suffix = {"RGBA": "Color", "FLOAT": "Float", "VECTOR": "Vector"}[data]
    factor_name = "Factor_Float"
    if data == "VECTOR" and node.factor_mode == "NON_UNIFORM":
        factor_name = "Factor_Vector"
    factor, a, b = (self.input(node, name, place) for name in (factor_name, f"A_{suffix}", f"B_{suffix}"))
    kind = node.blend_type if data == "RGBA" else "MIX"
    return _mixed(self, node, kind, factor, a, b, node.clamp_factor, node.clamp_result and data == "RGBA")


def _mix_rgb(self, node, output, place):
    factor, a, b = (self.input(node, name, place) for name in ("Fac", "Color1", "Color2"))
    return _mixed(self, node, node.blend_type, factor, a, b, True, node.use_clamp)


def _mixed(self, node, kind, factor, a, b, clamp_factor, clamp_result):
    if blended(kind, np.zeros(1), np.zeros(1), np.zeros(1)) is None:
        self.warn(f"node “{node.name}”: {kind.lower()} is taken for mix")
        kind = "MIX"

    def function(factor, a, b):
        factor = np.clip(factor, 0.0, 1.0) if clamp_factor else factor
        result = blended(kind, factor, a, b)
        return np.clip(result, 0.0, 1.0) if clamp_result else result

    # A picture that is mixed with nothing is still that picture.
    if kind == "MIX" and factor.is_constant:
        if factor.is_value(0.0):
            return a
        if factor.is_value(1.0):
            return b
    return combine(function, factor, a, b, lost=self._lost(node))


def _math(self, node, output, place):
    function = MATH.get(node.operation)
    if function is None:
        return self._guess(node, output)
    values = [self.socket(socket, place) for socket in node.inputs]
    values = [field if socket.enabled else Field.constant(0.0) for field, socket in zip(values, node.inputs)]

    def clamped(*arrays):
        result = function(*arrays)
        return np.clip(result, 0.0, 1.0) if node.use_clamp else result

    return combine(clamped, *values, lost=self._lost(node))


def _vector_math(self, node, output, place):
    functions = {
        "ADD": lambda a, b, c: a + b, "SUBTRACT": lambda a, b, c: a - b, "MULTIPLY": lambda a, b, c: a * b,
        "DIVIDE": lambda a, b, c: safe_divide(a, b), "MULTIPLY_ADD": lambda a, b, c: a * b + c,
        "MINIMUM": lambda a, b, c: np.minimum(a, b), "MAXIMUM": lambda a, b, c: np.maximum(a, b),
        "ABSOLUTE": lambda a, b, c: np.abs(a), "DOT_PRODUCT": lambda a, b, c: (a * b).sum(axis=2, keepdims=True),
        "LENGTH": lambda a, b, c: np.sqrt((a * a).sum(axis=2, keepdims=True)),
    }
    if node.operation == "SCALE":
        vector, scale = self.socket(node.inputs[0], place), self.input(node, "Scale", place)
        return combine(lambda a, b: a * b, vector, scale, lost=self._lost(node))
    if node.operation not in functions:
        return self._guess(node, output)
    values = [self.socket(socket, place) for socket in node.inputs[:3]]
    return combine(functions[node.operation], *values, lost=self._lost(node))


def _gamma(self, node, output, place):
    color, gamma = self.input(node, "Color", place), self.input(node, "Gamma", place)
    power = lambda c, g: np.where(c > 0.0, np.power(np.maximum(c, 0.0), g), c)
    return combine(power, color, gamma, lost=self._lost(node))


def _bright_contrast(self, node, output, place):
    fields = [self.input(node, name, place) for name in ("Color", "Bright", "Contrast")]
    function = lambda color, bright, contrast: np.maximum((1.0 + contrast) * color + bright - 0.5 * contrast, 0.0)
    return combine(function, *fields, lost=self._lost(node))


def _invert(self, node, output, place):
    factor, color = self.input(node, "Fac", place), self.input(node, "Color", place)
    return combine(lambda f, c: (1.0 - f) * c + f * (1.0 - c), factor, color, lost=self._lost(node))


def _hue_saturation(self, node, output, place):
    fields = [self.input(node, name, place) for name in ("Color", "Hue", "Saturation", "Value", "Fac")]

    def function(color, hue, saturation, value, factor):
        h, s, v = to_hsv(color)
        h = h + hue[:, :, 0] + 0.5
        changed = from_hsv(h, np.clip(s * saturation[:, :, 0], 0.0, 1.0), v * value[:, :, 0])
        return np.maximum((1.0 - factor) * color + factor * changed, 0.0)

    return combine(function, *fields, lost=self._lost(node))


def _ramp(self, node, output, place):
    table = np.array([node.color_ramp.evaluate(i / (_STEPS - 1)) for i in range(_STEPS)], np.float32)
    columns = [3] if output.name == "Alpha" else [0, 1, 2]
    steps = node.color_ramp.interpolation == "CONSTANT"

    def function(factor):
        x = np.clip(factor[:, :, 0], 0.0, 1.0) * (_STEPS - 1)
        if steps:
            return table[np.floor(x).astype(int)][:, :, columns]
        return np.stack([np.interp(x, np.arange(_STEPS), table[:, i]) for i in columns], axis=2)

    return combine(function, self.input(node, "Fac", place))


def _curves(self, node, output, place):
    mapping = node.mapping
    mapping.initialize()
    is_number = node.bl_idname == "ShaderNodeFloatCurve"
    grid = np.linspace(0.0, 1.0, _STEPS)

    def table(curve):
        return np.array([mapping.evaluate(curve, float(x)) for x in grid])

    if is_number:
        own = table(mapping.curves[0])
        factor, value = self.input(node, "Factor", place), self.input(node, "Value", place)
        return combine(lambda f, v: (1.0 - f) * v + f * np.interp(v, grid, own), factor, value, lost=self._lost(node))
    if node.bl_idname == "ShaderNodeVectorCurve":
        return self._guess(node, output)
    tables, common = [table(mapping.curves[i]) for i in range(3)], table(mapping.curves[3])

    def function(factor, color):
        # The common curve comes first.
        changed = np.interp(color, grid, common)
        changed = np.stack([np.interp(changed[:, :, i], grid, tables[i]) for i in range(3)], axis=2)
        return (1.0 - factor) * color + factor * changed

    return combine(function, self.input(node, "Fac", place), self.input(node, "Color", place), lost=self._lost(node))


def _map_range(self, node, output, place):
    if node.data_type != "FLOAT" or node.interpolation_type not in ("LINEAR", "SMOOTHSTEP"):
        return self._guess(node, output)
    names = ("Value", "From Min", "From Max", "To Min", "To Max")
    fields = [self.input(node, name, place) for name in names]
    smooth = node.interpolation_type == "SMOOTHSTEP"

    def function(value, low, high, new_low, new_high):
        t = safe_divide(value - low, high - low)
        if smooth or node.clamp:
            t = np.clip(t, 0.0, 1.0)
        t = t * t * (3.0 - 2.0 * t) if smooth else t
        return new_low + t * (new_high - new_low)

    return combine(function, *fields, lost=self._lost(node))


def _clamp(self, node, output, place):
    fields = [self.input(node, name, place) for name in ("Value", "Min", "Max")]
    return combine(lambda v, low, high: np.minimum(np.maximum(v, low), high), *fields, lost=self._lost(node))


def _separate(self, node, output, place):
    if getattr(node, "mode", "RGB") != "RGB":
        if node.mode == "HSV":
            index = [socket.name for socket in node.outputs].index(output.name)
            return combine(lambda c: to_hsv(c)[index][:, :, None], self.socket(node.inputs[0], place))
        return self._guess(node, output)
    index = [socket.identifier for socket in node.outputs].index(output.identifier)
    return self.socket(node.inputs[0], place).channel(index)


def _combine(self, node, output, place):
    parts = [self.socket(socket, place) for socket in node.inputs[:3]]
    mode = getattr(node, "mode", "RGB")
    if mode == "HSL":
        return self._guess(node, output)

    def function(*arrays):
        x, y, z = np.broadcast_arrays(*(array[:, :, 0] for array in arrays))
        return from_hsv(x, y, z) if mode == "HSV" else np.stack([x, y, z], axis=2)

    return combine(function, *parts, lost=self._lost(node))


def _to_gray(self, node, output, place):
    return self.input(node, "Color", place).as_number()


def _own_value(self, node, output, place):
    value = output.default_value
    return Field.constant(value if hasattr(value, "__len__") else float(value))


def _fresnel(self, node, output, place):
    """Seen from the front: what depends on the view cannot be a texture."""
    if node.bl_idname == "ShaderNodeFresnel":
        index = max(self.number(node, "IOR", place), 1e-5)
        value = ((index - 1.0) / (index + 1.0)) ** 2
    else:
        value = 0.0
    self.warn(f"node “{node.name}” depends on the view: {value:.3g}, as seen from the front, stands for it")
    return Field.constant(value)


def _profile(self, node, output, place):
    self.warn(f"node “{node.name}”: its profile is left out: only its strength counts")
    return self.input(node, "Strength", place)


def _falloff(self, node, output, place):
    if output.name != "Quadratic" or not self.input(node, "Smooth", place).is_value(0.0):
        self.warn(f"node “{node.name}”: its falloff is left out: light falls off with the square of the distance")
    return self.input(node, "Strength", place)


def _light_path(self, node, output, place):
    self.warn(f"node “{node.name}”: “{output.name}” is taken for 0, whatever the ray")
    return Field.constant(0.0)


def _geometry(self, node, output, place):
    if output.name == "Backfacing":
        self.warn(f"node “{node.name}”: both sides are taken for the front")
        return Field.constant(0.0)
    return self._guess(node, output)


def _black_body(self, node, output, place):
    import bpy

    # Blender computes it for lights.
    light = bpy.data.lights.new("fanal black body", "POINT")
    try:
        light.use_temperature = True
        light.temperature = min(max(self.number(node, "Temperature", place), 800.0), 20000.0)
        return Field.constant(list(light.temperature_color))
    except AttributeError:
        return self._guess(node, output)
    finally:
        bpy.data.lights.remove(light)


_NODES = {
    "ShaderNodeTexImage": _image,
    "ShaderNodeTexChecker": _checker,
    "ShaderNodeMix": _mix,
    "ShaderNodeMixRGB": _mix_rgb,
    "ShaderNodeMath": _math,
    "ShaderNodeVectorMath": _vector_math,
    "ShaderNodeGamma": _gamma,
    "ShaderNodeBrightContrast": _bright_contrast,
    "ShaderNodeInvert": _invert,
    "ShaderNodeHueSaturation": _hue_saturation,
    "ShaderNodeValToRGB": _ramp,
    "ShaderNodeRGBCurve": _curves,
    "ShaderNodeFloatCurve": _curves,
    "ShaderNodeMapRange": _map_range,
    "ShaderNodeClamp": _clamp,
    "ShaderNodeSeparateColor": _separate,
    "ShaderNodeSeparateRGB": _separate,
    "ShaderNodeSeparateXYZ": _separate,
    "ShaderNodeCombineColor": _combine,
    "ShaderNodeCombineRGB": _combine,
    "ShaderNodeCombineXYZ": _combine,
    "ShaderNodeRGBToBW": _to_gray,
    "ShaderNodeRGB": _own_value,
    "ShaderNodeValue": _own_value,
    "ShaderNodeFresnel": _fresnel,
    "ShaderNodeLayerWeight": _fresnel,
    "ShaderNodeTexIES": _profile,
    "ShaderNodeLightFalloff": _falloff,
    "ShaderNodeLightPath": _light_path,
    "ShaderNodeNewGeometry": _geometry,
    "ShaderNodeBlackbody": _black_body,
}

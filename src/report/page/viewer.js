// The picture viewer of a report: fills <section id="viewer"> from window.fanal, which the page's other scripts set.
// A plain script without requests, since browsers refuse modules and fetch on pages that are opened from disk.
(() => {
    "use strict";

    const page = window.fanal;
    const root = document.getElementById("viewer");
    if (!page || !root) return;

    const { width, height } = page;
    const REFERENCE = "reference";
    const MAX_ZOOM = 32;
    const WORST_ZOOM = 8;
    // How far a pointer may move, in CSS pixels, and still click.
    const CLICK_SLACK = 4;
    // Powers of ten at the ends of the colour scales, of errors as of densities.
    const [LOWEST, HIGHEST] = [-3, 3];

    // ---- Pictures

    const decoded = new Map();

    const hasPicture = name => Boolean(page.pictures?.[name]);

    function bytesOf(base64) {
        return Uint8Array.from(atob(base64), character => character.charCodeAt(0));
    }

    function halfToNumber(bits) {
        const sign = bits & 0x8000 ? -1 : 1;
        const exponent = (bits >> 10) & 31;
        const mantissa = bits & 1023;
        if (exponent === 0) return sign * mantissa * 2 ** -24;
        if (exponent === 31) return mantissa ? NaN : sign * Infinity;
        return sign * (1024 + mantissa) * 2 ** (exponent - 25);
    }

    function decodePicture(name) {
        const bytes = bytesOf(page.pictures[name].data);
        return Float32Array.from({ length: width * height * 3 }, (_, i) => halfToNumber(bytes[2 * i] | (bytes[2 * i + 1] << 8)));
    }

    function picture(name) {
        if (!decoded.has(name)) decoded.set(name, decodePicture(name));
        return decoded.get(name);
    }

    function relativeError(name, pixel) {
        const [values, reference] = [picture(name), picture(REFERENCE)];
        let sum = 0;
        for (let i = 3 * pixel; i < 3 * pixel + 3; i++) {
            sum += (values[i] - reference[i]) ** 2 / (reference[i] ** 2 + 0.01);
        }
        return sum / 3;
    }

    // ---- Colours

    // Inferno at steps of a tenth, its first colour darkened to black, which is to mean "no error".
    const INFERNO = [
        [0, 0, 0], [22, 11, 57], [66, 10, 104], [106, 23, 110], [147, 38, 103], [188, 55, 84],
        [221, 81, 58], [243, 120, 25], [252, 165, 10], [246, 215, 70], [252, 255, 164],
    ];

    const clamp = (value, low, high) => Math.min(high, Math.max(low, value));

    function colourAt(position) {
        const scaled = clamp(position, 0, 1) * (INFERNO.length - 1);
        const below = Math.min(Math.floor(scaled), INFERNO.length - 2);
        return INFERNO[below].map((low, channel) => low + (INFERNO[below + 1][channel] - low) * (scaled - below));
    }

    const COLOURS = Array.from({ length: 256 }, (_, i) => colourAt(i / 255));

    function errorColour(error) {
        // A value that is no number is as wrong as one can be.
        const position = Number.isNaN(error) ? 1 : (Math.log10(error) - LOWEST) / (HIGHEST - LOWEST);
        return COLOURS[Math.round(255 * clamp(position, 0, 1))];
    }

    function toDisplay(linear) {
        return 255 * (linear <= 0.0031308 ? 12.92 * linear : 1.055 * linear ** (1 / 2.4) - 0.055);
    }

    function paintPixels(target, columns, rows, colourOf) {
        [target.width, target.height] = [columns, rows];
        const context = target.getContext("2d");
        const image = context.createImageData(columns, rows);
        for (let pixel = 0; pixel < columns * rows; pixel++) {
            image.data.set(colourOf(pixel), 4 * pixel);
            image.data[4 * pixel + 3] = 255;
        }
        context.putImageData(image, 0, 0);
    }

    function radianceColours(name) {
        const [values, gain] = [picture(name), 2 ** state.exposure];
        return pixel => [0, 1, 2].map(channel => toDisplay(gain * values[3 * pixel + channel]));
    }

    const errorColours = name => pixel => errorColour(relativeError(name, pixel));

    // ---- Elements

    function make(tag, properties = {}, ...children) {
        const element = document.createElement(tag);
        for (const [name, value] of Object.entries(properties)) {
            if (name in element) element[name] = value;
            else element.setAttribute(name, value);
        }
        element.append(...children);
        return element;
    }

    const button = (text, onclick, properties = {}) => make("button", { type: "button", onclick, ...properties }, text);

    const powerOfTen = exponent => (10 ** exponent).toFixed(Math.max(0, -exponent));

    function legend(title) {
        const bar = make("div", { className: "bar" });
        bar.style.background = `linear-gradient(to right, ${INFERNO.map(colour => `rgb(${colour})`)})`;
        const ticks = Array.from({ length: HIGHEST - LOWEST + 1 }, (_, i) => make("span", {}, powerOfTen(LOWEST + i)));
        return make("div", { className: "legend" }, make("div", {}, title), bar, make("div", { className: "ticks" }, ...ticks));
    }

    function pictureSelect(id) {
        const options = [...page.methods, REFERENCE].map(name => {
            const text = hasPicture(name) ? name : `${name} (no picture)`;
            return make("option", { value: name, disabled: !hasPicture(name) }, text);
        });
        return make("select", { id }, ...options);
    }

    const labelled = (text, control) => make("label", { htmlFor: control.id }, text);

    const firstPicture = names => names.find(hasPicture) ?? REFERENCE;

    const state = {
        a: firstPicture(page.methods),
        b: firstPicture(["neural", ...page.methods.slice(1)]),
        split: 0.5,
        exposure: page.exposure ?? 0,
        errors: false,
        // 1 fits the picture to the canvas.
        zoom: 1,
        centre: [width / 2, height / 2],
        hover: null,
        mark: null,
        guidePoint: null,
    };

    root.append(make("h2", {}, "Compare the pictures"));
    if (!hasPicture(state.a) || !hasPicture(state.b)) {
        root.append(make("p", {}, "This report holds no pictures."));
        return;
    }

    const pick = { a: pictureSelect("pick-a"), b: pictureSelect("pick-b") };
    const captions = { a: make("span"), b: make("span") };
    const canvas = make("canvas", {
        id: "canvas", tabIndex: 0, role: "application", "aria-label": "Pictures A and B", "aria-describedby": "viewer-help",
    });
    const context = canvas.getContext("2d");
    const split = make("input", { type: "range", id: "split", min: 0, max: 100, step: 0.1 });
    const exposure = make("input", { type: "range", id: "exposure", min: -8, max: 8, step: 0.25 });
    const stops = make("output", { htmlFor: "exposure" });
    const errors = make("input", { type: "checkbox", id: "errors", disabled: !hasPicture(REFERENCE) });
    const errorLegend = legend("Relative squared error");
    const zoomLevel = make("output", { id: "zoom-level" });
    const readout = make("div", { id: "readout", "aria-live": "polite" });
    const guides = make("div", { id: "guides", "aria-live": "polite" });

    // ---- Where things are: picture coordinates are in pixels from the top left, canvas coordinates in its own pixels

    const scale = () => state.zoom * canvas.width / width;

    // Canvas pixels per CSS pixel.
    const density = () => canvas.width / Math.max(1, canvas.clientWidth);

    function toCanvas([x, y]) {
        return [
            (x - state.centre[0]) * scale() + canvas.width / 2,
            (y - state.centre[1]) * scale() + canvas.height / 2,
        ];
    }

    function toPicture([x, y]) {
        return [
            (x - canvas.width / 2) / scale() + state.centre[0],
            (y - canvas.height / 2) / scale() + state.centre[1],
        ];
    }

    function eventPosition(event) {
        const box = canvas.getBoundingClientRect();
        return [(event.clientX - box.left) * density(), (event.clientY - box.top) * density()];
    }

    function pixelAt(position) {
        const [x, y] = toPicture(position).map(Math.floor);
        return x >= 0 && y >= 0 && x < width && y < height ? [x, y] : null;
    }

    function moveCentre([x, y]) {
        const [halfWidth, halfHeight] = [width, height].map(side => side / 2 / state.zoom);
        state.centre = [clamp(x, halfWidth, width - halfWidth), clamp(y, halfHeight, height - halfHeight)];
    }

    // Keeps the picture's point at `position` where it is on the canvas. Says whether anything changed.
    function zoomAround(position, zoom) {
        const before = state.zoom;
        const fixed = toPicture(position);
        state.zoom = clamp(zoom, 1, MAX_ZOOM);
        const moved = toPicture(position);
        moveCentre(state.centre.map((centre, axis) => centre + fixed[axis] - moved[axis]));
        refresh();
        return state.zoom !== before;
    }

    function zoomBy(factor) {
        const middle = [canvas.width / 2, canvas.height / 2];
        const mark = state.mark && toCanvas(pixelCentre(state.mark));
        const visible = mark && mark[0] >= 0 && mark[1] >= 0 && mark[0] <= canvas.width && mark[1] <= canvas.height;
        zoomAround(visible ? mark : middle, state.zoom * factor);
    }

    const pixelCentre = ([x, y]) => [x + 0.5, y + 0.5];

    // Moves the view only as far as is needed to see the pixel.
    function reveal(pixel) {
        const half = [width, height].map(side => side / 2 / state.zoom - 0.5);
        moveCentre(pixelCentre(pixel).map((c, axis) => clamp(state.centre[axis], c - half[axis], c + half[axis])));
    }

    // ---- Drawing

    const layers = { a: { canvas: make("canvas") }, b: { canvas: make("canvas") } };

    function layerOf(side) {
        const layer = layers[side];
        const key = [state[side], state.errors || state.exposure].join();
        if (layer.key !== key) {
            const colours = (state.errors ? errorColours : radianceColours)(state[side]);
            paintPixels(layer.canvas, width, height, colours);
            layer.key = key;
        }
        return layer.canvas;
    }

    function drawSide(side, left, right) {
        context.save();
        context.beginPath();
        context.rect(left, 0, right - left, canvas.height);
        context.clip();
        context.imageSmoothingEnabled = scale() < 1;
        context.drawImage(layerOf(side), ...toCanvas([0, 0]), width * scale(), height * scale());
        context.restore();
    }

    // White in black, to be seen on any picture.
    function strokeVisibly(path) {
        for (const [colour, lineWidth] of [["black", 4], ["white", 2]]) {
            context.strokeStyle = colour;
            context.lineWidth = lineWidth * density();
            context.stroke(path);
        }
    }

    function drawMark() {
        const size = Math.max(scale(), 8 * density()) + 2 * density();
        const [x, y] = toCanvas(pixelCentre(state.mark));
        const path = new Path2D();
        path.rect(x - size / 2, y - size / 2, size, size);
        strokeVisibly(path);
    }

    function drawGuidePoint() {
        const path = new Path2D();
        path.arc(...toCanvas(pixelCentre(state.guidePoint)), 5 * density(), 0, 2 * Math.PI);
        strokeVisibly(path);
    }

    function draw() {
        const line = state.split * canvas.width;
        drawSide("a", 0, line);
        drawSide("b", line, canvas.width);
        const path = new Path2D();
        path.moveTo(line, 0);
        path.lineTo(line, canvas.height);
        strokeVisibly(path);
        if (state.guidePoint) drawGuidePoint();
        if (state.mark) drawMark();
    }

    function fitCanvas() {
        canvas.width = Math.max(1, Math.round(canvas.clientWidth * (window.devicePixelRatio || 1)));
        canvas.height = Math.max(1, Math.round(canvas.width * height / width));
        draw();
    }

    // ---- What the controls say

    const short = value => String(Number(value.toPrecision(3)));

    function sideReadout(side, pixel) {
        const name = state[side];
        const colour = [...picture(name).subarray(3 * pixel, 3 * pixel + 3)].map(short).join(", ");
        const error = hasPicture(REFERENCE) ? `, relative squared error ${short(relativeError(name, pixel))}` : "";
        return `${side.toUpperCase()} ${name}: RGB ${colour}${error}`;
    }

    function showReadout() {
        const shown = state.hover ?? state.mark;
        const lines = ["Point at the picture to read its values."];
        if (shown) {
            const pixel = shown[1] * width + shown[0];
            lines.splice(0, 1, `Pixel (${shown.join(", ")})`, sideReadout("a", pixel), sideReadout("b", pixel));
        }
        readout.replaceChildren(...lines.map(line => make("div", {}, line)));
    }

    function refresh() {
        for (const side of ["a", "b"]) {
            pick[side].value = state[side];
            captions[side].textContent = `${side.toUpperCase()}: ${page.pictures[state[side]].label}`;
        }
        split.value = 100 * state.split;
        exposure.value = state.exposure;
        exposure.disabled = state.errors;
        stops.textContent = `${state.exposure > 0 ? "+" : ""}${state.exposure} stops`;
        errors.checked = state.errors;
        errorLegend.hidden = !state.errors;
        zoomLevel.textContent = `${Number(state.zoom.toFixed(1))}×`;
        // Where there is nothing to pan, a finger that moves up or down scrolls the page.
        canvas.style.touchAction = state.zoom > 1 ? "none" : "pan-y";
        showReadout();
        draw();
    }

    function set(changes) {
        Object.assign(state, changes);
        refresh();
    }

    // ---- Guides

    function nearestPoint([x, y]) {
        const distances = page.guides.points.map(point => Math.hypot(point[0] - x, point[1] - y));
        return distances.indexOf(Math.min(...distances));
    }

    // A map has φ along its rows' order and z along its columns'; it is drawn with φ to the right and z upwards.
    function guideCanvas(bytes, name) {
        const side = page.guides.side;
        const target = make("canvas", { role: "img", "aria-label": `Guide of ${name}: density over φ and z` });
        paintPixels(target, side, side, pixel => {
            const [phi, z] = [pixel % side, side - 1 - Math.floor(pixel / side)];
            return COLOURS[bytes[phi * side + z]];
        });
        return target;
    }

    function guideFigure(name, index) {
        const base64 = page.guides.maps[name][index];
        if (!base64) return make("div", { className: "guide" }, make("h3", {}, name), make("p", {}, "no guide here"));
        const vertical = make("div", { className: "z" }, ...["1", "z", "−1"].map(text => make("span", {}, text)));
        const horizontal = make("div", { className: "phi" }, ...["0", "φ", "2π"].map(text => make("span", {}, text)));
        return make("div", { className: "guide" }, make("h3", {}, name), vertical, guideCanvas(bytesOf(base64), name), horizontal);
    }

    function showGuides() {
        if (!page.guides?.points.length) {
            guides.replaceChildren(make("p", {}, "There is no guide in this report."));
            return;
        }
        if (!state.mark) {
            guides.replaceChildren(make("p", {}, "Click on the picture to see where rays are sent from there."));
            return;
        }
        const index = nearestPoint(state.mark);
        state.guidePoint = page.guides.points[index];
        const text = `Guides at pixel (${state.guidePoint.join(", ")}), the point nearest to pixel (${state.mark.join(", ")})`;
        const figures = Object.keys(page.guides.maps).map(name => guideFigure(name, index));
        guides.replaceChildren(
            make("p", {}, text),
            make("div", { className: "maps" }, ...figures),
            legend("Density relative to uniform"),
        );
    }

    function mark(pixel) {
        state.mark = pixel;
        showGuides();
        refresh();
    }

    // ---- Worst places

    function showWorst({ x, y, method }) {
        Object.assign(state, { a: method, b: firstPicture([REFERENCE, state.b]), zoom: WORST_ZOOM, hover: null });
        moveCentre(pixelCentre([x, y]));
        mark([x, y]);
    }

    function worstList() {
        const places = (page.worst ?? []).filter(place => hasPicture(place.method));
        if (!places.length) return make("p", {}, "None are listed.");
        return make("ol", { className: "places" }, ...places.map(place => {
            const text = `${place.method} (${place.x}, ${place.y}): error ${short(place.error)}`;
            return make("li", {}, button(text, () => showWorst(place), { className: "worst" }));
        }));
    }

    // ---- Pointer, wheel and keys on the canvas

    const pointers = new Map();
    let gesture = null;
    let dragged = false;

    function isOnSplit(event) {
        const reach = event.pointerType === "touch" ? 22 : 8;
        return Math.abs(eventPosition(event)[0] - state.split * canvas.width) <= reach * density();
    }

    function startGesture(event) {
        if (event.button !== 0) return;
        pointers.set(event.pointerId, eventPosition(event));
        dragged = pointers.size > 1;
        gesture = pointers.size > 1 ? "pinch" : isOnSplit(event) ? "split" : "pan";
    }

    function pinch(moving, to) {
        const [, other] = [...pointers].find(([id]) => id !== moving);
        const from = pointers.get(moving);
        const apart = position => Math.max(1, Math.hypot(position[0] - other[0], position[1] - other[1]));
        const middle = to.map((c, axis) => (c + other[axis]) / 2);
        zoomAround(middle, state.zoom * apart(to) / apart(from));
    }

    function moveGesture(event) {
        const from = pointers.get(event.pointerId);
        if (!from) return;
        const to = eventPosition(event);
        const delta = to.map((c, axis) => c - from[axis]);
        dragged ||= Math.hypot(...delta) > CLICK_SLACK * density();
        if (!dragged) return;
        if (gesture === "pinch") pinch(event.pointerId, to);
        else if (gesture === "split") set({ split: clamp(to[0] / canvas.width, 0, 1) });
        else {
            moveCentre(state.centre.map((c, axis) => c - delta[axis] / scale()));
            refresh();
        }
        pointers.set(event.pointerId, to);
    }

    function endGesture(event) {
        pointers.delete(event.pointerId);
        gesture = "pan";
    }

    function hover(event) {
        const panning = state.zoom > 1 ? "grab" : "crosshair";
        canvas.style.cursor = isOnSplit(event) ? "ew-resize" : panning;
        state.hover = pixelAt(eventPosition(event));
        showReadout();
    }

    function click(event) {
        const pixel = pixelAt(eventPosition(event));
        if (!dragged && pixel) mark(pixel);
    }

    function wheel(event) {
        const pixels = event.deltaY * (event.deltaMode === WheelEvent.DOM_DELTA_LINE ? 33 : 1);
        const factor = 2 ** (-clamp(pixels, -200, 200) / 200);
        // A wheel that can zoom no further scrolls the page.
        if (zoomAround(eventPosition(event), state.zoom * factor)) event.preventDefault();
    }

    function step(dx, dy) {
        const [x, y] = state.mark ?? state.centre.map(Math.floor);
        const pixel = [clamp(x + dx, 0, width - 1), clamp(y + dy, 0, height - 1)];
        state.hover = null;
        reveal(pixel);
        mark(pixel);
    }

    const fit = () => zoomAround([0, 0], 1);

    function key(event) {
        if (event.ctrlKey || event.metaKey || event.altKey) return;
        const far = event.shiftKey ? 10 : 1;
        const actions = {
            ArrowLeft: () => step(-far, 0), ArrowRight: () => step(far, 0), ArrowUp: () => step(0, -far), ArrowDown: () => step(0, far),
            "+": () => zoomBy(2), "=": () => zoomBy(2), "-": () => zoomBy(0.5), "0": fit,
        };
        const action = actions[event.key];
        if (!action) return;
        event.preventDefault();
        action();
    }

    function listen() {
        pick.a.addEventListener("change", () => set({ a: pick.a.value }));
        pick.b.addEventListener("change", () => set({ b: pick.b.value }));
        split.addEventListener("input", () => set({ split: split.value / 100 }));
        exposure.addEventListener("input", () => set({ exposure: Number(exposure.value) }));
        errors.addEventListener("change", () => set({ errors: errors.checked }));
        canvas.addEventListener("pointerdown", startGesture);
        canvas.addEventListener("pointermove", hover);
        canvas.addEventListener("pointerleave", () => set({ hover: null }));
        canvas.addEventListener("click", click);
        canvas.addEventListener("wheel", wheel, { passive: false });
        canvas.addEventListener("keydown", key);
        // On the window, because a drag goes on outside the canvas.
        window.addEventListener("pointermove", moveGesture);
        window.addEventListener("pointerup", endGesture);
        window.addEventListener("pointercancel", endGesture);
        new ResizeObserver(fitCanvas).observe(canvas);
    }

    // ---- The page

    function controls() {
        const row = (...children) => make("div", { className: "row" }, ...children);
        const pair = (...children) => make("span", { className: "pair" }, ...children);
        const resetExposure = button("Reset", () => set({ exposure: page.exposure ?? 0 }), { id: "exposure-reset" });
        return make("div", { className: "controls" },
            row(pair(labelled("A, left", pick.a), pick.a), pair(labelled("B, right", pick.b), pick.b)),
            row(labelled("Exposure", exposure), exposure, stops, resetExposure),
            row(pair(errors, labelled("Show errors against the reference", errors))),
            errorLegend,
            row(
                make("span", {}, "Zoom"),
                button("−", () => zoomBy(0.5), { id: "zoom-out", "aria-label": "Zoom out" }),
                button("+", () => zoomBy(2), { id: "zoom-in", "aria-label": "Zoom in" }),
                button("fit", fit, { id: "zoom-fit" }),
                zoomLevel,
            ),
        );
    }

    function build() {
        const help = "Drag the line to compare, drag elsewhere to pan, turn the wheel to zoom, click to mark a pixel. "
            + "Keys: arrows move the mark (with Shift by ten), + and − zoom, 0 fits.";
        const stage = make("div", { className: "stage" },
            make("div", { className: "sides" }, captions.a, captions.b),
            canvas,
            labelled("Split between A and B", split), split,
            readout,
            make("p", { id: "viewer-help", className: "note" }, help),
        );
        // Leaves room for the controls on a wide, low window.
        stage.style.maxWidth = `max(20rem, ${85 * width / height}vh)`;
        canvas.style.aspectRatio = `${width} / ${height}`;
        const panel = make("div", { className: "panel" },
            controls(),
            make("h3", {}, "Worst places"), worstList(),
            make("h3", {}, "Guides"), guides,
        );
        root.append(make("div", { className: "viewer" }, stage, panel));
    }

    build();
    listen();
    showGuides();
    refresh();
    fitCanvas();
})();

// Drives a report page as a reader would and writes what it found to <html data-result="…">: "ok", or the failures,
// separated by "; ".
//
// A test copies the page's folder and puts this file's text into index.html twice, each time in its own <script>:
// first thing in <head>, where it only starts to collect errors, and last in <body>, where it also drives the page once
// everything is loaded. (Put in only last, it works too, but misses the errors of the scripts before it.) Then
//     chromium --headless --no-sandbox --window-size=1600,1200 --dump-dom file:///…/index.html
// prints the document with its data-result. Without that attribute the page did not finish loading. Chromium makes no window
// narrower than 500 pixels; a phone's width takes --screen-info={400x800} --start-maximized in place of --window-size.

if (!window.pageErrors) {
    window.pageErrors = [];
    // Capturing, because the error event of a script that is not found does not bubble.
    window.addEventListener("error", event => {
        window.pageErrors.push(event.message ?? `cannot load ${event.target.src ?? event.target.href}`);
    }, true);
    window.addEventListener("unhandledrejection", event => window.pageErrors.push(`unhandled rejection: ${event.reason}`));
    const report = console.error;
    console.error = (...values) => {
        window.pageErrors.push(`console.error: ${values.join(" ")}`);
        report.apply(console, values);
    };
}

if (document.body) window.addEventListener("load", () => {
    "use strict";

    const failures = [];
    const element = id => document.getElementById(id);
    const check = (holds, expectation) => {
        if (!holds) failures.push(expectation);
    };

    // A step that throws must not keep the other steps from running.
    function step(name, action) {
        try {
            action();
        } catch (error) {
            failures.push(`${name}: ${error}`);
        }
    }

    function pixels() {
        const canvas = element("canvas");
        return canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height).data;
    }

    function changesPixels(action) {
        const before = pixels();
        action();
        const after = pixels();
        return before.length !== after.length || before.some((value, i) => value !== after[i]);
    }

    function choose(id, value) {
        element(id).value = value;
        element(id).dispatchEvent(new Event("input", { bubbles: true }));
        element(id).dispatchEvent(new Event("change", { bubbles: true }));
    }

    const zoom = () => element("zoom-level").textContent;

    function changesZoom(action) {
        const before = zoom();
        action();
        return zoom() !== before;
    }

    // A place of the canvas, given in fractions of its width and height, in whole pixels of the window: mouse events have
    // no others.
    function inWindow([x, y]) {
        const box = element("canvas").getBoundingClientRect();
        return { clientX: Math.round(box.left + x * box.width), clientY: Math.round(box.top + y * box.height) };
    }

    function pixelUnder(place) {
        const [box, { clientX, clientY }] = [element("canvas").getBoundingClientRect(), inWindow(place)];
        const { width, height } = window.fanal;
        return [(clientX - box.left) / box.width * width, (clientY - box.top) / box.height * height].map(Math.floor);
    }

    function send(Type, name, place, details = {}) {
        element("canvas").dispatchEvent(new Type(name, { ...inWindow(place), bubbles: true, cancelable: true, ...details }));
    }

    function drag(from, to) {
        send(PointerEvent, "pointerdown", from, { pointerId: 1, buttons: 1 });
        send(PointerEvent, "pointermove", to, { pointerId: 1, buttons: 1 });
        send(PointerEvent, "pointerup", to, { pointerId: 1 });
    }

    function clickAt(place) {
        send(PointerEvent, "pointermove", place, { pointerId: 1 });
        send(PointerEvent, "pointerdown", place, { pointerId: 1, buttons: 1 });
        send(PointerEvent, "pointerup", place, { pointerId: 1 });
        send(MouseEvent, "click", place);
    }

    function drivePictures() {
        const first = pixels().slice(0, 3);
        check(pixels().some((value, i) => i % 4 < 3 && value !== first[i % 4]), "the canvas is uniform");
        for (const option of element("pick-a").options) {
            if (!option.disabled) choose("pick-a", option.value);
        }
        const [methods, held] = [window.fanal.methods, name => window.fanal.pictures[name]];
        choose("pick-b", "reference");
        check(changesPixels(() => choose("pick-a", methods.find(held))), "choosing picture A leaves the canvas as it was");
    }

    function driveSplit() {
        check(changesPixels(() => choose("split", 20)), "moving the split leaves the canvas as it was");
        drag([0.2, 0.5], [0.6, 0.5]);
        check(Math.abs(element("split").value - 60) < 1, "dragging the line does not move the split");
        choose("split", 50);
    }

    function driveLooks() {
        check(changesPixels(() => choose("exposure", 2)), "the exposure leaves the canvas as it was");
        check(changesPixels(() => element("exposure-reset").click()), "resetting the exposure leaves the canvas as it was");
        check(changesPixels(() => element("errors").click()), "showing errors leaves the canvas as it was");
        // The reference is on the right.
        const [width, row] = [element("canvas").width, pixels().subarray(0, 4 * element("canvas").width)];
        const right = row.subarray(4 * Math.ceil(0.75 * width));
        check(right.every((value, i) => i % 4 === 3 || value === 0), "the reference's own error is not black");
        check(changesPixels(() => element("errors").click()), "hiding errors leaves the canvas as it was");
    }

    function driveZoom() {
        check(changesZoom(() => element("zoom-in").click()), "zoom + leaves the level as it was");
        check(changesPixels(() => drag([0.2, 0.3], [0.3, 0.4])), "dragging does not pan");
        check(changesZoom(() => element("zoom-out").click()), "zoom − leaves the level as it was");
        check(changesZoom(() => send(WheelEvent, "wheel", [0.25, 0.25], { deltaY: -200 })), "the wheel leaves the level as it was");
        element("zoom-fit").click();
        check(zoom() === "1×", "fit does not zoom to 1×");
    }

    function driveWorst() {
        const worst = document.querySelector(".worst");
        if (!worst) return;
        worst.click();
        const { x, y, method } = window.fanal.worst.find(place => window.fanal.pictures[place.method]);
        check(zoom() === "8×", "a worst place does not zoom to 8×");
        check(element("pick-a").value === method, "a worst place does not choose its method");
        check(element("pick-b").value === "reference", "a worst place does not choose the reference");
        check(element("readout").textContent.includes(`(${x}, ${y})`), "a worst place does not mark its pixel");
        element("zoom-fit").click();
    }

    function driveGuides() {
        // Inside a pixel of a small picture, not on its edge.
        const place = [0.31, 0.615];
        const pixel = `(${pixelUnder(place).join(", ")})`;
        check(changesPixels(() => clickAt(place)), "a click on the picture does not mark the pixel");
        check(element("readout").textContent.includes(pixel), `the read-out does not show ${pixel}`);
        const { guides } = window.fanal;
        const shown = element("guides").querySelectorAll(".guide").length;
        check(shown === Object.keys(guides?.maps ?? {}).length, `a click shows ${shown} guides`);
        if (!guides) check(/no guide/i.test(element("guides").textContent), "nothing says that there is no guide");
    }

    function driveKeys() {
        const press = key => element("canvas").dispatchEvent(new KeyboardEvent("keydown", { key, bubbles: true, cancelable: true }));
        const readout = () => element("readout").textContent;
        const before = readout();
        press("ArrowRight");
        check(readout() !== before, "an arrow key does not move the mark");
        press("ArrowLeft");
        check(readout() === before, "the opposite arrow key does not move the mark back");
        check(changesZoom(() => press("+")), "the key + leaves the level as it was");
        check(changesZoom(() => press("0")), "the key 0 leaves the level as it was");
    }

    step("pictures", drivePictures);
    step("split", driveSplit);
    step("exposure and errors", driveLooks);
    step("zoom", driveZoom);
    step("worst places", driveWorst);
    step("guides", driveGuides);
    step("keys", driveKeys);
    const [needed, available] = [document.documentElement.scrollWidth, window.innerWidth];
    check(needed <= available, `the page is ${needed} wide in a window of ${available}`);
    document.documentElement.dataset.result = [...failures, ...window.pageErrors].join("; ") || "ok";
});

// The page: what is shown of which frame, controls, and a run in progress.

const part = (id) => document.getElementById(id);

// Time between two looks at a run [ms].
const PATIENCE = 1000;

let run = null;
// The frame that is shown, and the number of the last wish for one: an answer to an older wish is dropped.
let shown = null, wish = 0, isLoading = false;
let mode = "plain", isPlaying = false, playedAt = 0;
let values = [];
const hidden = new Set();

// Shows a frame once everything of it is there.
async function show(frame) {
    const number = ++wish;
    const { objects, attempt } = run;
    const path = (i, field) => `object/${i}/frame/${frame}/${field}`;
    isLoading = true;
    try {
        const wanted = objects.map((object) => mode !== "plain" && object.has_fields);
        const [points, fields] = await Promise.all([
            Promise.all(objects.map((_, i) => arrays.get(path(i, "points")))),
            Promise.all(objects.map((_, i) => (wanted[i] ? arrays.get(path(i, mode)) : null))),
        ]);
        if (number !== wish || attempt !== run.attempt || stage.meshes.length !== objects.length) return;
        const painted = objects.filter((_, i) => wanted[i]);
        const range = mode === "plain" ? null : MODES[mode].range(painted, fields.filter(Boolean));
        objects.forEach((object, i) => {
            const colours = fields[i] ? paint(mode, fields[i], range, object) : mode !== "plain" && object.kind === "cloth" ? NOTHING : object.colour;
            stage.setFrame(i, points[i], colours);
        });
        values = fields;
        shown = frame;
        legend(mode, range, painted);
        look();
        if (!stage.isFitted) {
            stage.draw(0);
            stage.fit(objects);
        }
        part("vertex").hidden = true;
        say({ frame: "" });
    } catch (error) {
        if (number === wish) say({ frame: error.message });
    } finally {
        if (number === wish) isLoading = false;
        tell();
    }
}

// What is hidden and how the rest is drawn.
function look() {
    stage.meshes.forEach((mesh, i) => {
        const { name, kind } = run.objects[i];
        mesh.visible = shown !== null && !hidden.has(name);
        mesh.material.wireframe = part("wireframe").checked && kind === "cloth";
    });
    stage.orbit.autoRotate = part("turntable").checked;
    stage.needsDrawing = true;
}

// What is wrong with the run, and with the frame that was last wished for.
const alarms = { run: "", frame: "" };

function say(changed) {
    Object.assign(alarms, changed);
    const text = alarms.run || alarms.frame;
    part("alarm").textContent = text;
    part("alarm").hidden = !text;
}

// The line about the run.
function tell() {
    if (!run) return;
    const { frames } = run, place = frames.indexOf(shown);
    const words = [];
    if (run.frames_done === 0) words.push(run.state === "running" ? "waiting for the first frame" : "no frames");
    else if (shown !== null) words.push(`frame ${shown} (${place + 1} of ${frames.length}${ofRun()})`);
    if (run.state === "killed") words.push("the process of the run ended without a message");
    else if (run.state === "running") {
        const when = held ? "running when this page was written" : "running";
        words.push(`${when}: ${run.frames_done} of ${run.frames_total} frames${left(run.seconds_left)}`);
    }
    else words.push(run.state + (run.reason && run.reason !== run.state ? `: ${run.reason}` : ""));
    if (run.error && run.state === "failed") words.push(run.error.split("\n")[0]);
    part("status").textContent = words.join(", ");
    Object.assign(part("slider"), { max: Math.max(frames.length - 1, 0), value: Math.max(place, 0), ariaValueText: `frame ${shown}` });
    part("play").textContent = isPlaying ? "pause" : "play";
    part("play").ariaPressed = String(isPlaying);
}

// A page that was written may hold fewer frames than the run.
function ofRun() {
    return run.frames_of_run > run.frames.length ? ` in this page, ${run.frames_of_run} in the run` : "";
}

function left(seconds) {
    if (seconds === null) return "";
    return seconds < 100 ? `, ${Math.ceil(seconds)} s left` : `, ${Math.ceil(seconds / 60)} min left`;
}

// Takes in what the run is now; the latest frame is shown when it is followed.
async function renew(now) {
    const marks = (of) => JSON.stringify([of.attempt, of.frames.length > 0, of.objects.map(({ name, points }) => [name, points])]);
    const isOther = !run || marks(run) !== marks(now);
    const wasLast = !run || shown === null || shown === run.frames.at(-1);
    if (isOther) {
        arrays.forget();
        const triangles = await Promise.all(now.objects.map((_, i) => (now.frames.length ? arrays.get(`object/${i}/triangles`) : new Uint32Array())));
        stage.setObjects(now.objects, triangles);
        shown = null;
    }
    const had = run?.frames.length ?? 0;
    run = now;
    if (isOther) describe();
    part("notices").textContent = now.notices.join("\n");
    if (!now.frames.length) return tell();
    const goes = now.state === "running";
    if (shown === null) await show(goes || held === null ? now.frames.at(-1) : now.frames[0]);
    else if (!now.frames.includes(shown)) await show(now.frames.at(-1));
    else if (part("follow").checked && wasLast && now.frames.length > had && !isPlaying) await show(now.frames.at(-1));
    else tell();
}

// Name, garments and modes of the run.
function describe() {
    part("shot").textContent = run.shot || "run";
    document.title = `${run.shot || "run"}: Drapery`;
    const boxes = run.objects.map((object) => {
        const input = Object.assign(document.createElement("input"), { type: "checkbox", checked: !hidden.has(object.name) });
        input.addEventListener("change", () => {
            hidden[input.checked ? "delete" : "add"](object.name);
            look();
        });
        const swatch = Object.assign(document.createElement("i"), { className: "swatch" });
        swatch.style.background = rgb(object.colour);
        const label = document.createElement("label");
        label.append(input, " ", swatch, ` ${object.name}${object.material ? ` (${object.material})` : ""}`);
        return label;
    });
    part("objects").replaceChildren(...boxes);
    const hasFields = run.objects.some((object) => object.has_fields);
    for (const input of part("modes").querySelectorAll("input")) input.disabled = input.value !== "plain" && !hasFields && run.frames.length > 0;
    part("follow").parentElement.hidden = held !== null;
}

async function watch() {
    try {
        await renew(await state());
        say({ run: "" });
    } catch (error) {
        say({ run: error.message });
    }
    if (!held) setTimeout(watch, PATIENCE);
}

// Shows a frame by its place among those that are there.
function go(place) {
    if (run?.frames.length) show(run.frames[Math.min(Math.max(place, 0), run.frames.length - 1)]);
}

function step(by) {
    go(run.frames.indexOf(shown) + by);
}

function play(on) {
    isPlaying = on && run?.frames.length > 1;
    // From the start if there is nothing after the frame that is shown.
    if (isPlaying && shown === run.frames.at(-1)) go(0);
    tell();
}

function setMode(name) {
    const input = part("modes").querySelector(`[value=${name}]`);
    if (input.disabled) return;
    input.checked = true;
    mode = name;
    if (shown !== null) show(shown);
}

function toggle(id) {
    part(id).checked = !part(id).checked;
    look();
}

function toggleBodies() {
    const bodies = run.objects.filter((object) => object.kind !== "cloth").map((object) => object.name);
    const isHidden = bodies.every((name) => hidden.has(name));
    for (const name of bodies) hidden[isHidden ? "delete" : "add"](name);
    describe();
    look();
}

// The numbers of a vertex.
function about(index, vertex) {
    const object = run.objects[index];
    const { position, color } = stage.meshes[index].geometry.attributes;
    const of = ({ array }) => [...array.subarray(3 * vertex, 3 * vertex + 3)];
    const value = values[index] ? values[index][vertex] : null;
    return { object: object.name, vertex, frame: shown, mode, position: of(position), value, colour: values[index] ? of(color) : null };
}

function readOut(event) {
    const bounds = part("canvas").getBoundingClientRect();
    const found = run && shown !== null ? stage.vertexAt(event.clientX - bounds.left, event.clientY - bounds.top) : null;
    part("vertex").hidden = !found;
    if (!found) return;
    const { object, vertex, position, value } = about(found.object, found.vertex);
    const lines = [`${object}, vertex ${vertex}`, `${position.map((x) => x.toFixed(4)).join(", ")} m`];
    if (value !== null) lines.push(`${mode}: ${Number.isNaN(value) ? "none" : MODES[mode].format(value)}`);
    part("vertex").textContent = lines.join("\n");
}

const KEYS = {
    " ": () => play(!isPlaying), ArrowLeft: () => step(-1), ArrowRight: () => step(1), Home: () => go(0), End: () => go(Infinity),
    1: () => setMode("plain"), 2: () => setMode("strain"), 3: () => setMode("thickness"), 4: () => setMode("contact"),
    w: () => toggle("wireframe"), t: () => toggle("turntable"), b: toggleBodies, f: () => stage.fit(run.objects), l: () => toggle("follow"),
};

function listen() {
    for (const input of part("modes").querySelectorAll("input")) input.addEventListener("change", () => setMode(input.value));
    for (const id of ["wireframe", "turntable"]) part(id).addEventListener("change", look);
    part("fit").addEventListener("click", () => run && stage.fit(run.objects));
    part("play").addEventListener("click", () => play(!isPlaying));
    part("slider").addEventListener("input", () => go(Number(part("slider").value)));
    document.addEventListener("keydown", (event) => {
        // Controls move by their own arrows, and are pressed by the space bar.
        const isOwn = ["BUTTON", "INPUT"].includes(event.target.tagName) && (event.key === " " || event.key.length > 1);
        const act = KEYS[event.key.length === 1 ? event.key.toLowerCase() : event.key];
        if (!act || !run || isOwn || event.ctrlKey || event.metaKey || event.altKey) return;
        event.preventDefault();
        act();
    });
    let pressed = [0, 0];
    part("canvas").addEventListener("pointerdown", (event) => (pressed = [event.clientX, event.clientY]));
    // A click, and not the end of a turn.
    part("canvas").addEventListener("click", (event) => Math.hypot(event.clientX - pressed[0], event.clientY - pressed[1]) < 4 && readOut(event));
}

function tick(now) {
    const seconds = Math.min((now - (tick.before ?? now)) / 1000, 0.1);
    tick.before = now;
    if (isPlaying && !isLoading && now - playedAt >= 1000 / run.fps) {
        playedAt = now;
        go((run.frames.indexOf(shown) + 1) % run.frames.length);
    }
    stage.draw(seconds);
    requestAnimationFrame(tick);
}

// For scripts: the same as the controls, and the numbers of a vertex.
window.viewer = {
    show, setMode, about, placeOf: (index, vertex) => stage.placeOf(index, vertex), pixel: (x, y) => stage.pixel(x, y),
    run: () => run, shown: () => shown,
};

try {
    stage.start(part("canvas"));
    listen();
    requestAnimationFrame(tick);
    watch();
} catch (error) {
    say({ run: `This browser draws nothing: ${error.message}. The page needs WebGL 2; see whether the browser has switched it off.` });
}

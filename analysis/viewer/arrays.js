// Arrays of the run: asked for one by one and kept up to a size, or taken from the page itself where it holds a run.

const held = JSON.parse(document.getElementById("run").textContent);

// Memory for arrays [bytes]: the frames that were looked at last.
const KEPT_BYTES = 256e6;

const FULL = 0, SHORT = 1;
// The short number that stands for "no value".
const NO_VALUE = 65535;

// The inverse of analysis/src/view/arrays.rs.
function decode(buffer) {
    const [encoding, components, count] = new Uint32Array(buffer, 0, 3);
    const length = components * count;
    if (encoding === FULL) return new Float32Array(buffer, 12, length);
    if (encoding !== SHORT) return new Uint32Array(buffer, 12, length);
    const ranges = new Float32Array(buffer, 12, 2 * components);
    const short = new Uint16Array(buffer, 12 + 8 * components, length);
    const values = new Float32Array(length);
    for (let i = 0; i < length; i++) {
        const low = ranges[2 * (i % components)], high = ranges[2 * (i % components) + 1];
        values[i] = short[i] === NO_VALUE ? NaN : low + (high - low) * (short[i] / (NO_VALUE - 1));
    }
    return values;
}

// Says why the program gave no answer; `gone` if there was none at all.
class NoAnswer extends Error {
    constructor(message, gone) {
        super(message);
        this.gone = gone;
    }
}

async function ask(path) {
    let answer;
    try {
        answer = await fetch(path, { cache: "no-store" });
    } catch {
        throw new NoAnswer("drapery view has ended, or this page cannot reach it. Start it again.", true);
    }
    if (!answer.ok) throw new NoAnswer(await answer.text(), false);
    return answer;
}

const arrays = {
    kept: new Map(),
    bytes: 0,

    forget() {
        this.kept.clear();
        this.bytes = 0;
    },

    // The array of a path; the one that was not used for the longest time is dropped when they take too much memory.
    async get(path) {
        const known = this.kept.get(path);
        if (known) {
            this.kept.delete(path);
            this.kept.set(path, known);
            return known;
        }
        const array = decode(held ? await fromPage(path) : await (await ask(path)).arrayBuffer());
        if (!this.kept.has(path)) this.bytes += array.byteLength;
        this.kept.set(path, array);
        for (const [oldest, dropped] of this.kept) {
            if (this.bytes <= KEPT_BYTES || oldest === path) break;
            this.kept.delete(oldest);
            this.bytes -= dropped.byteLength;
        }
        return array;
    },
};

function fromPage(path) {
    const text = atob(held.arrays[held.places[path]]);
    const bytes = new Uint8Array(text.length);
    for (let i = 0; i < text.length; i++) bytes[i] = text.charCodeAt(i);
    return bytes.buffer;
}

async function state() {
    return held ? held.state : (await ask("run.json")).json();
}

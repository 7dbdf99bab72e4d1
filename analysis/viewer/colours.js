// Colours of numbers, and the legend that says which is which.

// Viridis by its colours at equal distances: it is as even in grey, and is seen alike by people who see fewer colours.
const SCALE = [[68, 1, 84], [72, 40, 120], [62, 74, 137], [49, 104, 142], [38, 130, 142], [31, 158, 137], [53, 183, 121], [109, 205, 89],
    [180, 222, 44], [253, 231, 37]];
const BEYOND = [214, 40, 57];
const NOTHING = [170, 170, 168];
// Largest strain of the scale where no material says a limit.
const STRAIN = 0.1;

const rgb = ([r, g, b]) => `rgb(${r}, ${g}, ${b})`;

// Colour at a share of the scale, 0 to 1.
function scaled(share) {
    const at = Math.min(Math.max(share, 0), 1) * (SCALE.length - 1);
    const below = Math.min(Math.floor(at), SCALE.length - 2);
    return SCALE[below].map((low, i) => low + (at - below) * (SCALE[below + 1][i] - low));
}

const percent = (value) => `${+(100 * value).toPrecision(3)} %`;
const millimetres = (value) => `${+(1000 * value).toPrecision(3)} mm`;

// For each mode: the unit of a number, ends of the scale, the colour of a value of an object, and words.
const MODES = {
    strain: {
        title: "Strain: largest extension of the edges at a vertex",
        format: percent,
        range: (objects) => [0, Math.max(...objects.map((object) => object.strain_limit ?? STRAIN))],
        colour: (value, [, high], object) => (value > (object.strain_limit ?? Infinity) * 1.0001 ? BEYOND : scaled(value / high)),
        notes: (objects) => [
            ...objects.map((object) =>
                object.strain_limit === null ? `${object.name}: no limit known` : `${object.name}: limit ${percent(object.strain_limit)}`),
            [BEYOND, "beyond the limit of its fabric"],
        ],
    },
    thickness: {
        title: "Thickness that contact keeps",
        format: millimetres,
        range: (objects, values) => extent(values),
        colour: (value, [low, high]) => scaled(high > low ? (value - low) / (high - low) : 0.5),
        notes: () => [],
    },
    contact: {
        title: "Distance from other cloth or a body, by the thickness between them",
        format: (value) => `${+value.toPrecision(3)} ×`,
        range: () => [0, run.reach],
        // The closest is the brightest.
        colour: (value, [, high]) => scaled(1 - value / high),
        reversed: true,
        notes: () => [[NOTHING, `nothing within ${run.reach} times the thickness`]],
    },
};

function extent(arrays) {
    let low = Infinity, high = -Infinity;
    for (const values of arrays) {
        for (const value of values) {
            if (value < low) low = value;
            if (value > high) high = value;
        }
    }
    return low <= high ? [low, high] : [0, 0];
}

// Colours of all values of an object, three numbers each from 0 to 1, in the space in which light adds up.
function paint(mode, values, range, object) {
    const colours = new Float32Array(3 * values.length);
    for (let v = 0; v < values.length; v++) {
        const colour = Number.isNaN(values[v]) ? NOTHING : MODES[mode].colour(values[v], range, object);
        for (let i = 0; i < 3; i++) colours[3 * v + i] = linear(colour[i] / 255);
    }
    return colours;
}

// The curve of sRGB (IEC 61966-2-1).
const linear = (value) => (value <= 0.04045 ? value / 12.92 : ((value + 0.055) / 1.055) ** 2.4);

function legend(mode, range, objects) {
    const box = document.getElementById("legend");
    box.hidden = mode === "plain";
    if (box.hidden) return;
    const { title, format, reversed, notes } = MODES[mode];
    const stops = SCALE.map((_, i) => rgb(scaled(reversed ? 1 - i / (SCALE.length - 1) : i / (SCALE.length - 1))));
    const ticks = range[1] > range[0] ? [0, 0.5, 1] : [0.5];
    const element = (name, properties, ...children) => {
        const made = Object.assign(document.createElement(name), properties);
        made.append(...children);
        return made;
    };
    const bar = element("div", { className: "bar" });
    bar.style.background = range[1] > range[0] ? `linear-gradient(to right, ${stops.join(", ")})` : rgb(scaled(0.5));
    const numbers = ticks.map((share) => element("span", { textContent: format(range[0] + share * (range[1] - range[0])) }));
    const note = (text) => {
        if (typeof text === "string") return element("li", { textContent: text });
        const swatch = element("i", { className: "swatch" });
        swatch.style.background = rgb(text[0]);
        return element("li", {}, swatch, ` ${text[1]}`);
    };
    box.replaceChildren(element("div", { textContent: title }), bar, element("div", { className: "ticks" }, ...numbers),
        element("ul", {}, ...notes(objects).map(note)));
}

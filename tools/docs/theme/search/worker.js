// The engine of the book's search, in place of MkDocs' own (search/main.js asks it, and shows what it answers). One answer a page,
// with the section and the words that fit; pages for users come before those for developers, and a page that has all words of a
// question before one that says some of them often. Built on lunr, which MkDocs brings.

importScripts("lunr.js");

// By the beginning of a page's address; the first that fits. The glossary leads to pages, the rules of warnings are asked for by name.
const WEIGHTS = {
  "guide/glossary": 0.5,
  "guide/limits": 1.5,
  "reference/warnings": 0.7,
  start: 3,
  howto: 3,
  guide: 3,
  reference: 1.5,
  theory: 1,
  dev: 0.3,
};
const FIELDS = { words: 14, page: 6, title: 4, text: 1 };
const RESULTS = 12;
const EXCERPT = 220;
// For words that stand in the index in part or with a letter changed only.
const BEGINNING = 0.4;
const MISSPELT = 0.15;

let index;
const sections = {};

function build(data) {
  lunr.tokenizer.separator = new RegExp(data.config.separator);
  const titles = {};
  for (const section of data.docs) {
    if (!section.location.includes("#")) titles[section.location] = section.title;
  }
  index = lunr(function () {
    this.ref("location");
    // Long lists of symptoms count nearly as much as short ones.
    this.b(0.3);
    for (const [field, boost] of Object.entries(FIELDS)) this.field(field, { boost });
    for (const section of data.docs) {
      const page = section.location.split("#")[0];
      sections[section.location] = { ...section, page: titles[page], address: page };
      const weight = Object.entries(WEIGHTS).find(([beginning]) => page.startsWith(beginning));
      this.add({ words: "", ...section, page: titles[page] }, { boost: weight ? weight[1] : 1 });
    }
  });
}

// The stems of a question's words, without those that every text has.
function stems(question) {
  const tokens = lunr.tokenizer(question.toLowerCase());
  const stemmed = new lunr.Pipeline();
  stemmed.add(lunr.trimmer, lunr.stopWordFilter, lunr.stemmer);
  return [...new Set(stemmed.run(tokens).map(String).filter(Boolean))];
}

// What has the stem, with how well it fits: section -> score.
function matches(stem) {
  const ask = (clause) => index.query((query) => query.term(stem, { usePipeline: false, ...clause }));
  let found = ask({});
  if (!found.length) found = ask({ wildcard: lunr.Query.wildcard.TRAILING, boost: BEGINNING });
  if (!found.length && stem.length > 4 && stem.length < 20) found = ask({ editDistance: 1, boost: MISSPELT });
  const scores = {};
  for (const { ref, score } of found) scores[ref] = Math.max(scores[ref] || 0, score);
  return scores;
}

function search(question) {
  // A name as it is written, such as self_collision or [garment.pin], is asked for itself.
  const name = /[_.]/.test(question) ? question.replace(/[[\]`\s]/g, "") : "";
  const asked = stems(question);
  const all = asked.map((stem) => matches(stem));
  const pages = {};
  all.forEach((scores, i) => {
    for (const [location, score] of Object.entries(scores)) {
      const page = (pages[sections[location].address] ||= { best: asked.map(() => 0), sections: {} });
      page.best[i] = Math.max(page.best[i], score);
      (page.sections[location] ||= asked.map(() => 0))[i] = score;
    }
  });
  const rank = (scores) => scores.reduce((a, b) => a + b, 0) * (scores.filter(Boolean).length / asked.length) ** 2;
  const ranked = Object.entries(pages).map(([address, page]) => {
    const [location, scores] = Object.entries(page.sections)
      // The whole page is an entry of its own: a section says where to look.
      .map(([location, scores]) => [location, rank(scores) * (location === address ? 0.99 : 1) * (sections[location].title === name ? 10 : 1)])
      .reduce((a, b) => (b[1] > a[1] ? b : a));
    return { location, score: scores + rank(page.best) };
  });
  ranked.sort((a, b) => b.score - a.score || (a.location < b.location ? -1 : 1));
  return ranked.slice(0, RESULTS).map(({ location }) => answer(sections[location], asked));
}

function answer(section, asked) {
  const title = section.title === section.page ? section.page : `${section.page}: ${section.title}`;
  return { location: section.location, title, summary: excerpt(section.text, asked) };
}

// The stretch of a text that has most of the words.
function excerpt(text, asked) {
  const plain = text.replaceAll("¶", "").replace(/\s+/g, " ");
  const hits = [...plain.matchAll(/[\p{L}\p{N}]+/gu)].flatMap((word) => {
    const stem = lunr.stemmer(new lunr.Token(word[0].toLowerCase())).toString();
    const which = asked.findIndex((word) => stem.startsWith(word));
    return which < 0 ? [] : [{ at: word.index, which }];
  });
  const distinct = (first) => new Set(hits.slice(first).filter((hit) => hit.at < hits[first].at + EXCERPT).map((hit) => hit.which)).size;
  let best = 0;
  hits.forEach((_, i) => {
    if (distinct(i) > distinct(best)) best = i;
  });
  const middle = hits.length ? hits[best].at : 0;
  const start = middle > 30 ? plain.lastIndexOf(" ", middle - 30) + 1 : 0;
  const end = start + EXCERPT < plain.length ? plain.lastIndexOf(" ", start + EXCERPT) : plain.length;
  return `${start > 0 ? "… " : ""}${plain.slice(start, end)}${end < plain.length ? " …" : ""}`;
}

onmessage = (message) => {
  if (message.data.init) {
    fetch("search_index.json")
      .then((response) => response.json())
      .then((data) => {
        build(data);
        postMessage({ config: data.config });
        postMessage({ allowSearch: true });
      });
  } else if (message.data.query) {
    postMessage({ results: search(message.data.query) });
  }
};

/**
 * Figures of a page: fetched and drawn when they come into view, again when the page turns dark or light.
 * Vega's expressions are interpreted, since our policy lets no script make another out of text.
 */

/** From this file, in the order in which they need each other. */
const LIBRARIES = ["vega.min.js", "vega-lite.min.js", "vega-embed.min.js"];
/** A figure is begun this far before it is seen. */
const AHEAD = "200px";

const dark = matchMedia("(prefers-color-scheme: dark)");
/** @type {Promise<void> | undefined} */
let loaded;

/** @param {string} file */
function script(file) {
  return new Promise((resolve, reject) => {
    const element = document.createElement("script");
    element.src = new URL(`../vendor/${file}`, import.meta.url).href;
    element.onload = resolve;
    element.onerror = () => reject(new Error(`${file} did not load`));
    document.head.append(element);
  });
}

async function load() {
  for (const file of LIBRARIES) {
    await script(file);
  }
}

/**
 * A table that scrolls inside itself where it is wider than the page.
 * @param {{caption: string, header: string[], rows: string[][]}} summary
 */
function table({ caption, header, rows }) {
  const wrap = document.createElement("div");
  wrap.className = "table-wrap";
  wrap.setAttribute("role", "region");
  wrap.setAttribute("aria-label", caption);
  wrap.tabIndex = 0;
  const made = document.createElement("table");
  made.createCaption().textContent = caption;
  const heads = made.createTHead().insertRow();
  for (const name of header) {
    heads.append(Object.assign(document.createElement("th"), { textContent: name, scope: "col" }));
  }
  const body = made.createTBody();
  for (const [first, ...others] of rows) {
    const row = body.insertRow();
    row.append(Object.assign(document.createElement("th"), { textContent: first, scope: "row" }));
    for (const value of others) {
      row.insertCell().textContent = value;
    }
  }
  wrap.append(made);
  return wrap;
}

/** @param {HTMLElement} figure */
async function draw(figure) {
  const says = figure.querySelector("[data-says]");
  const place = figure.querySelector("[data-chart]");
  const notes = figure.querySelector("[data-notes]");
  const summaries = figure.querySelector("[data-summaries]");
  if (
    !(says instanceof HTMLElement) ||
    !(place instanceof HTMLElement) ||
    !(notes instanceof HTMLElement) ||
    !(summaries instanceof HTMLElement)
  ) {
    throw new Error("expected a place for the chart and its words");
  }
  const address = new URL(figure.dataset.figure ?? "", location.href);
  address.searchParams.set("theme", dark.matches ? "dark" : "light");
  figure.setAttribute("aria-busy", "true");
  try {
    loaded ??= load();
    const [answer] = await Promise.all([fetch(address, { redirect: "error" }), loaded]);
    if (!answer.ok) {
      throw new Error(`expected a figure, got ${answer.status}`);
    }
    const told = await answer.json();
    says.textContent = told.says;
    notes.replaceChildren(
      ...told.notes.map((/** @type {string} */ note) => Object.assign(document.createElement("li"), { textContent: note })),
    );
    notes.hidden = told.notes.length === 0;
    summaries.replaceChildren(...told.summaries.map(table));
    summaries.hidden = told.summaries.length === 0;
    place.hidden = told.chart === null;
    for (const link of figure.querySelectorAll("[data-picture]")) {
      link.toggleAttribute("hidden", told.chart === null);
    }
    if (told.chart) {
      await globalThis.vegaEmbed(place, told.chart, {
        ast: true,
        actions: false,
        renderer: "canvas",
        // Their style elements would be refused: app.css has what is needed.
        defaultStyle: false,
        tooltip: { disableDefaultStyle: true },
      });
    }
    figure.dataset.drawn = "yes";
  } catch (error) {
    loaded = undefined;
    says.textContent = "The figure could not be drawn. Reload the page, or take its data as CSV.";
    console.error(error);
  } finally {
    figure.removeAttribute("aria-busy");
  }
}

const figures = [...document.querySelectorAll("[data-figure]")].filter((element) => element instanceof HTMLElement);
/** One after the other: the server draws them, and the page has one thread. */
let turn = Promise.resolve();

const watcher = new IntersectionObserver(
  (entries) => {
    for (const { isIntersecting, target } of entries) {
      if (isIntersecting && target instanceof HTMLElement) {
        watcher.unobserve(target);
        turn = turn.then(() => draw(target));
      }
    }
  },
  { rootMargin: AHEAD },
);
figures.forEach((figure) => watcher.observe(figure));

dark.addEventListener("change", () => {
  for (const figure of figures) {
    if (figure.dataset.drawn) {
      turn = turn.then(() => draw(figure));
    }
  }
});

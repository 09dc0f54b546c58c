/**
 * Translates the texts of scripts into the page's language. Scripts contain the English texts; a page in another
 * language carries the translations of all of them.
 */

const carried = document.getElementById("words")?.textContent;
/** @type {Record<string, string>} */
const translations = carried ? JSON.parse(carried) : {};
const numbers = numberFormat();

/** @returns {{format: (number: number) => string}} as the page's language writes them, or plainly */
function numberFormat() {
  try {
    return new Intl.NumberFormat(document.body.lang || document.documentElement.lang);
  } catch {
    return { format: String };
  }
}

/**
 * @param {string} english with places such as %(number)s
 * @param {Record<string, string | number>} [values] what stands there; numbers are written as the language writes them
 * @returns {string}
 */
export function gettext(english, values = {}) {
  const text = translations[english] ?? english;
  return text.replace(/%\((\w+)\)s/g, (_place, name) => {
    const value = values[name];
    return typeof value === "number" ? numbers.format(value) : value;
  });
}

/**
 * Mark an element that holds the study's own words: they may be in another language than the page's.
 * @param {HTMLElement} element
 */
export function inStudysLanguage(element) {
  const { lang, dir } = document.documentElement;
  if (document.body.lang && document.body.lang !== lang) {
    element.lang = lang;
    element.dir = dir || "ltr";
  }
}

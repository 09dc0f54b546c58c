/**
 * Changes a part of the page into a newer version of it and leaves equal nodes in place, so that focus, selection and
 * scroll position are kept.
 */

/**
 * @param {Element} now on the page
 * @param {Element} next as it is to be; its parts may be taken out of it
 */
export function morph(now, next) {
  if (now.isEqualNode(next)) {
    return;
  }
  for (const { name } of [...now.attributes]) {
    // What a reader has opened stays open.
    if (!next.hasAttribute(name) && !(now instanceof HTMLDetailsElement && name === "open")) {
      now.removeAttribute(name);
    }
  }
  for (const { name, value } of next.attributes) {
    if (now.getAttribute(name) !== value) {
      now.setAttribute(name, value);
    }
  }
  if (next.hasAttribute("data-keyed")) {
    morphKeyed(now, next);
  } else {
    morphInOrder(now, next);
  }
}

/**
 * Children that have a key, such as a table's rows: each is followed wherever it goes.
 * @param {Element} now
 * @param {Element} next
 */
function morphKeyed(now, next) {
  const known = new Map([...now.children].map((child) => [child.getAttribute("data-key"), child]));
  let place = now.firstElementChild;
  for (const wanted of [...next.children]) {
    const key = wanted.getAttribute("data-key");
    const child = known.get(key);
    if (!child) {
      now.insertBefore(wanted, place);
      continue;
    }
    known.delete(key);
    morph(child, wanted);
    if (child === place) {
      place = place.nextElementSibling;
    } else {
      now.insertBefore(child, place);
    }
  }
  for (const gone of known.values()) {
    gone.remove();
  }
}

/**
 * @param {Element} now
 * @param {Element} next
 */
function morphInOrder(now, next) {
  const wanted = [...next.childNodes];
  [...now.childNodes].slice(wanted.length).forEach((child) => child.remove());
  wanted.forEach((node, index) => {
    const child = now.childNodes[index];
    if (!child) {
      now.append(node);
    } else if (child instanceof Element && node instanceof Element && child.tagName === node.tagName) {
      morph(child, node);
    } else if (child.nodeType === Node.TEXT_NODE && node.nodeType === Node.TEXT_NODE) {
      if (child.textContent !== node.textContent) {
        child.textContent = node.textContent;
      }
    } else {
      child.replaceWith(node);
    }
  });
}

/** A page's globals, as far as the scripts under test use them: Node's test runner has none. */

export function newPage() {
  const page = new EventTarget();
  globalThis.window = page;
  globalThis.document = Object.assign(new EventTarget(), {
    documentElement: { lang: "en", dataset: {} },
    visibilityState: "visible",
    getElementById: () => null,
  });
  for (const name of ["localStorage", "sessionStorage"]) {
    const items = new Map();
    const storage = {
      getItem: (key) => items.get(key) ?? null,
      setItem: (key, value) => void items.set(key, String(value)),
      removeItem: (key) => void items.delete(key),
    };
    Object.defineProperty(globalThis, name, { value: storage, configurable: true, writable: true });
    page[name] = storage;
  }
  return page;
}

newPage();

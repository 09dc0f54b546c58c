/**
 * Times in the reader's own form and zone; what the server wrote, in UTC, stays as their title.
 */

const form = new Intl.DateTimeFormat(document.documentElement.lang, { dateStyle: "medium", timeStyle: "short" });

/** @param {ParentNode} root */
export function showLocalTimes(root) {
  for (const time of root.querySelectorAll("time[datetime]")) {
    const moment = new Date(time.getAttribute("datetime") ?? "");
    if (!Number.isNaN(moment.valueOf())) {
      time.setAttribute("title", time.textContent ?? "");
      time.textContent = form.format(moment);
    }
  }
}

/**
 * An answer sent by the page's form, as a browser sends it without any script. The next pair comes as a page.
 *
 * @typedef {{query_id: string, response: string, rt_ms: number, skip_reason?: string}} Sent
 */

/**
 * @param {HTMLFormElement} form
 * @param {Sent} answer
 */
export function sendByForm(form, answer) {
  const fields = {
    query_id: answer.query_id,
    response: answer.response,
    rt_ms: Number.isFinite(answer.rt_ms) ? String(answer.rt_ms) : "",
    skip_reason: answer.skip_reason ?? "",
  };
  for (const [name, value] of Object.entries(fields)) {
    const present = form.querySelector(`input[name="${name}"]`);
    const field = present instanceof HTMLInputElement ? present : document.createElement("input");
    field.type = "hidden";
    field.name = name;
    field.value = value;
    form.append(field);
  }
  HTMLFormElement.prototype.submit.call(form);
}

/**
 * Forms that upload files: refuses files that are too large before sending, and shows the progress.
 */

import { announce } from "./dom.js";

for (const form of document.querySelectorAll("form[data-limit-mb]")) {
  if (!(form instanceof HTMLFormElement)) {
    continue;
  }
  const files = form.querySelector("input[type=file]");
  const tooMuch = form.querySelector("[data-too-much]");
  const bar = form.querySelector("progress");
  const button = form.querySelector("button");
  form.addEventListener("submit", (event) => {
    if (!(files instanceof HTMLInputElement) || !(bar instanceof HTMLProgressElement) || !(tooMuch instanceof HTMLElement) || button === null) {
      return;
    }
    event.preventDefault();
    const size = Array.from(files.files ?? []).reduce((sum, file) => sum + file.size, 0);
    const number = files.files?.length ?? 0;
    tooMuch.hidden = size <= Number(form.dataset.limitMb) * 1e6 && number <= Number(form.dataset.mostFiles);
    if (!tooMuch.hidden) {
      return;
    }
    bar.hidden = size === 0;
    button.disabled = true;
    announce("The files are being sent.");
    const request = new XMLHttpRequest();
    request.open("POST", form.action);
    request.responseType = "document";
    request.upload.addEventListener("progress", (sent) => {
      bar.value = sent.lengthComputable ? sent.loaded / sent.total : 0;
    });
    request.addEventListener("load", () => {
      const answer = request.responseXML;
      if (request.status < 400 || answer?.querySelector("main") == null) {
        location.assign(request.responseURL);
        return;
      }
      // Refused: the answer is this page again, with the reasons. What was chosen stays chosen.
      const reasons = answer.querySelector("[data-testid=refused]") ?? answer.querySelector("main");
      document.querySelector("[data-testid=refused]")?.remove();
      if (reasons !== null) {
        document.querySelector("main")?.querySelector(".desk-head, h1")?.after(document.adoptNode(reasons));
        reasons.scrollIntoView({ block: "nearest" });
      }
      bar.hidden = true;
      button.disabled = false;
    });
    request.addEventListener("error", () => {
      bar.hidden = true;
      button.disabled = false;
      announce("The files could not be sent. Please try again.");
      button.textContent = "Send again";
    });
    request.send(new FormData(form));
  });
}

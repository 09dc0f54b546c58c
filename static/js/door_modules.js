/**
 * Says that this browser can run what the pages of a session are made of: it has read all of it by the time this runs.
 */

import "./answers.js";
import "./api.js";
import "./evidence.js";
import "./keys.js";
import "./outbox.js";
import "./pace.js";
import "./pair.js";
import "./reasons.js";
import "./theatre.js";
import "./undo.js";

document.documentElement.dataset.modules = "ready";

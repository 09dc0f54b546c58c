/**
 * Marks the browser as able to run the modules of the session pages: they have all been parsed when this runs.
 */

import "./answers.js";
import "./api.js";
import "./evidence.js";
import "./keys.js";
import "./outbox.js";
import "./eta.js";
import "./synced_pair.js";
import "./skip_reasons.js";
import "./fullscreen.js";
import "./undo.js";

document.documentElement.dataset.modules = "ready";

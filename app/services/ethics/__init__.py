"""Documents for an ethics board, generated from the study: texts, data inventory, screenshots."""

"""What an ethics board asks of a study to show, worked out from the study itself."""

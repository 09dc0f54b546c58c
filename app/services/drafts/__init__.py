"""Studies being made in the browser: their files, uploads and transcoding."""

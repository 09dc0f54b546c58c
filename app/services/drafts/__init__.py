"""Study drafts that are edited in the browser: their files, uploads and transcoding."""

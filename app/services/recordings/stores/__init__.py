"""Where the files of recordings are kept: folders of this machine, or an S3-compatible store."""

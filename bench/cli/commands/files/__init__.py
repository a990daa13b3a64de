"""Commands on recordings as files, a file each; no drive and no service is there."""

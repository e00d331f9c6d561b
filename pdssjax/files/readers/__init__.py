"""The formats that records are read from: a family, one file a format; `pdssjax.files.channel_samples` opens them."""

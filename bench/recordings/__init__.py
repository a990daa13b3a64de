"""Recordings on disk: read as samples, written as captures, and run through the streaming core.

* `table` - CSV and Parquet to columns; `forms` - what other tools make of tables, times and quantities
* `sources` - where each quantity comes from; `runs` - time base and gaps
* `recording` - a file to samples; `long_recording` - what of a long one is diagnosed
* `part_file` - work on disk that outlives its process; `seal` - a Parquet file's checksum; `capture_file` - a capture
* `screen` - rows that no machine makes; `judgement` - whether constant parameters explain a recording;
  `turned` - whether angle and speed tell the same
* `replay` - the streaming core over a recording

Knows nothing of drives and services.
"""

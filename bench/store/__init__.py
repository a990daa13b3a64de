"""What is kept of drives: recordings of their stream, the shelf on which all recordings stand, what is remembered.

* `rows` - rows of the stream as bytes, and as a Parquet's columns; `timeline` - when each was made
* `segments` - a recording under way on disk; `closing` - what becomes of it: one Parquet
* `samples` - a recording's columns for a plot, by `thinning`; `overview` - what a long one is plotted by
* `importing` - a file of somebody's to a recording; `export` - a recording in another tool's form
* `sealed_file` - how a recording is written
* `catalogue` - settings and the past; `write_log` - what was written to drives, and what was refused
* `annotations` - titles, notes and marks, beside a recording; `shelf` - all recordings of a folder
* `diagnoses` - those that have ended

Files are the truth. Knows nothing of links, threads and HTTP.
"""

"""Recordings in forms of other tools: MATLAB's .mat and ASAM MDF, read to a plain Parquet and written from one.

* `content` - what such a file holds: columns, units, notes
* `mat` - MATLAB level 5 and 4, and 7.3 where h5py is there; `mdf` - MDF 4 where asammdf is there
* `__main__` - one of these at work, in a process of its own: libraries that take foreign bytes apart may crash, and
  take any memory and time; the one for MDF is under the LGPL
* `process` - starts that process, bounds its memory and time, and tells what went wrong

Knows nothing of what columns mean.
"""

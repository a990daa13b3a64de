"""Where a recording and a machine's data differ: whether, where, by which physics, and how sure that is.

`diagnose` takes a recording's samples and a nominal machine and returns a `verdict.Diagnosis`. Its rooms, in the order
in which a recording goes through them:

* `intake` - user errors before physics: bad samples, units, signs, conventions, data sheets
* `angle` - what an encoder's counts leave of the angle
* `likelihood` - a recording as one regression: whitening, noise, columns, evidence, what can be identified
* `search` - the set of effects that the recording calls for, and its best fit
* `where` - regions, spectra, the place of a mismatch
* `unnamed` - what has no name in the library, described
* `trust` - how often chance would show as much; rivals
* `answer` - findings, parameters, sentences, pictures, what to record next
* `points`, `standstill` - the same question to tables of steady points and to motors that stand
* `watch` - whether constant parameters still explain a stream

`verdict` is what comes out, `words` how numbers stand in sentences.
"""

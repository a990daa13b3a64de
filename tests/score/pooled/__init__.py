"""The pooled score: what the diagnosis says of 1,734 recordings, beside what a kept library said of the same.

* `population` - the recordings of three populations that were looked at: what makes each anew, and its hash
* `outcome` - what was said of one, in a line, and whether it is right
* `pairwise` - two libraries, recording by recording: gained, lost, changed, by whole groups with McNemar's p
* `work` - recordings made, checked and diagnosed in processes; what is done is kept, so that a stopped run goes on

`python -m tests.score.pooled` prints the comparison with `baseline.tsv`.
"""

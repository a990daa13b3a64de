"""Several recordings of one machine in one diagnosis.

* `said` - what comes of it
* `alike` - whether numbers of several recordings are one number; that number
* `refitted` - each recording fitted with the effects of all
* `decided` - doubts of one recording that another settles; `differences` - what is not alike, in words
* `together` - the way from recordings to what is said
"""

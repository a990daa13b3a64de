"""The pictures of a diagnosis as data: what is drawn, not how. The report and the page draw the same.

* `figure` - panels, axes and traces, their JSON, and the schema of that
* `pictures` - a diagnosis to figures; `forest` - one of several recordings
* `axes` - ends of axes, digits of numbers; `thinning` - no more points than a picture shows

Colours and styles are none of it: a trace has a role, and whoever draws it knows what that looks like.
"""

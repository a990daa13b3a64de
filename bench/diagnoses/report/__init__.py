"""A diagnosis as a page: one HTML file that needs nothing else, no script either. It prints.

* `page` - the page; its words and their order are in `page.html.jinja`, its looks, light and dark, in `page.css`
* `together` - that of several recordings, by `together.html.jinja`
* `drawing` - a figure as a vector picture: `layout` has its panels, `traces` what is drawn over them
* `scales` - where numbers stand along an axis, and which are told; `svg` - elements
"""

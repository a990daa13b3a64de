"""The operator's page: plain ES modules over HTTP, no build step, no outside address.

The service sends `index.html` at `/`, the files of this room at `/web/<file>` and plotly's own bundle at
`/assets/plotly.min.js`. One noun a file:

* `main.js` - wires the others together and sets the pace of drawing
* `connection.js` - the drive list and the event stream, and what to do when they break
* `api.js` - the REST calls and the shapes they carry; `problem` sentences become errors
* `parameters.js` - the four parameters; `format.js` - numbers, units, times as an operator reads them
* `panels/` - the parts of the page: `banner.js`, `header.js`, `control_bar.js` (who is in control, and Stop),
  `tiles.js`, `mismatch.js`, `plots.js`, `capture_panel.js`, `window_form.js` with the Kalman filter's `tuning_form.js`
* `fields.js` - fields of any form
* `history.js` - what the plots remember: bounded, and never older values passed off as new

Knows nothing of drives, estimators or buses: only the JSON that the REST tables describe.
"""

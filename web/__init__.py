"""The operator's page: plain ES modules over HTTP, no build step, no outside address.

The service sends `index.html` at `/`, the files of this room at `/web/<file>` and plotly's own bundle at
`/assets/plotly.min.js`. One noun a file:

* `main.js` - wires the others together and sets the pace of drawing; `router.js` - which room is shown
* `connection.js` - the drive list and the event stream, and what to do when they break
* `api.js` - the REST calls and the shapes they carry; `problem` sentences become errors
* `panels/` - the bar that is in every room (`banner`, `header`, `control_bar`, `set_points`), and the parts of Live:
  `tiles` with `mismatch`, `strips` and `vector` over `recent`, `plots` over `history`, `record_panel`,
  `capture_panel`, `window_form` with the Kalman filter's `tuning_form`
* `rooms/` - Recordings (`recordings`, `recording_view`, `recording_plot`, `recording_name`, `bring_file`), Diagnosis
  (`diagnosis`, `diagnosis_view`, `figures`, `quantity`, `diagnose_it`), Drive (`drive`,
  `signals_view`, `parameters_view` with `plan_view` and `flash_view`)
* `parameters.js` - the four parameters; `format.js` - numbers, units, times as an operator reads them
* `fields.js` - fields of any form; `dom.js` - elements made by code; `dialog.js` - a question before what cannot be
  undone; `plot.js` - what all plots have in common

Knows nothing of drives, estimators or buses: only the JSON that the REST tables describe.
"""

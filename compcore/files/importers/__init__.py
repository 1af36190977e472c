"""Other measuring systems' files to campaigns; each says the sign it assumed.

===============  ==================================================================
`lines`          along an axis: tables of runs and directions as ISO 230-2 prints
                 them (CSV), Renishaw laser measurements (``.rtl``, ``.rta``)
`ballbar`        circular tests with a ball bar (CSV)
`rotary`         spheres on a turning table: R-tests, ball bars, touches by a probe
`artefacts`      gauge blocks, step gauges, ball plates and hole plates
`log`            a logger's table: thermometers and indicators, a row a moment (CSV)
`tpoint`         stars that a telescope pointed at, as TPOINT reads them
`map_rows`       a compensation map, as the measurements it would have come from
===============  ==================================================================

All lay their readings along the axes by `placing`; tables of cells are read by `sheets`.
"""

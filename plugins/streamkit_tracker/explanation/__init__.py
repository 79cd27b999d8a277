"""Explains where a track came from, by the file that tracksink wrote.

`command` takes the moments of one track from the file, `life` sums them up, `wording` puts them in words;
`command` is `streamkit explain`.
"""

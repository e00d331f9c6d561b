"""The page of `pdssjax explore`, made of Panel and Bokeh; what it shows is computed in the folder above."""

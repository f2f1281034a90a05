"""truepose: calibrate precision robots and find the physics their models leave out."""

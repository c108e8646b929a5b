"""The views below the scene, one figure of the lesson each: from an answer to a picture and a page's part beside it."""

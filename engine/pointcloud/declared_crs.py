"""The coordinate reference system that a file declares, as WKT or GeoTIFF keys."""

from __future__ import annotations

from pyproj import CRS
from pyproj.exceptions import CRSError

from ..core.messages import shown
from .geotiff_keys import crs_from_keys
from .header import CloudHeader


def declared_crs(header: CloudHeader) -> tuple[CRS | None, tuple[str, ...]]:
    """The reference system in the file's records and warnings about those: WKT first, else GeoTIFF keys."""
    name = shown(header.path)
    warnings: list[str] = []
    if header.wkt is not None:
        text = header.wkt.split(b"\0")[0].decode("utf-8", "replace").strip()
        if text:
            try:
                return CRS.from_wkt(text), ()
            except CRSError:
                warnings.append(f"{name} declares a reference system in WKT that cannot be read.")
    if header.geotiff_keys is not None:
        try:
            crs = crs_from_keys(
                header.geotiff_keys,
                header.vlrs.get(("LASF_Projection", 34736), b""),
                header.vlrs.get(("LASF_Projection", 34737), b""),
            )
        except (CRSError, ValueError) as error:
            warnings.append(f"{name} declares a reference system in GeoTIFF keys that cannot be read ({error}).")
        else:
            if crs is not None:
                return crs, tuple(warnings)
    return None, tuple(warnings)

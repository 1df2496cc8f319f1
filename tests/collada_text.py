"""COLLADA files of one mesh: trimesh writes them with pycollada only, which nothing else needs."""

import numpy as np
import trimesh


def collada_text(mesh: trimesh.Trimesh, *assets: str) -> str:
    """Write a mesh as a COLLADA file whose asset element holds `assets`."""
    numbers, corners = (" ".join(map(str, np.ravel(values).tolist())) for values in (mesh.vertices, mesh.faces))
    params = "".join(f'<param name="{axis}" type="float"/>' for axis in "XYZ")
    accessor = f'<accessor source="#numbers" count="{len(mesh.vertices)}" stride="3">{params}</accessor>'
    array = f'<float_array id="numbers" count="{mesh.vertices.size}">{numbers}</float_array>'
    return (
        '<?xml version="1.0"?><COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">'
        f'<asset>{"".join(assets)}</asset><library_geometries><geometry id="shape"><mesh>'
        f'<source id="positions">{array}<technique_common>{accessor}</technique_common></source>'
        '<vertices id="vertices"><input semantic="POSITION" source="#positions"/></vertices>'
        f'<triangles count="{len(mesh.faces)}"><input semantic="VERTEX" source="#vertices" offset="0"/><p>{corners}</p></triangles>'
        '</mesh></geometry></library_geometries><library_visual_scenes><visual_scene id="scene"><node id="node">'
        '<instance_geometry url="#shape"/></node></visual_scene></library_visual_scenes>'
        '<scene><instance_visual_scene url="#scene"/></scene></COLLADA>'
    )

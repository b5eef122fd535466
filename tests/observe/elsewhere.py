"""Files of tracks as other tools write them, laid out by hand from those tools' own descriptions."""

import json
import pickle

import h5py
import numpy as np

SCORER = "DLC_resnet50_linkageNov21shuffle1_100000"
COORDS = ("x", "y", "likelihood")


def dlc_csv(path, px, likelihood, scorer=SCORER):
    """DeepLabCut's `analyze_videos(..., save_as_csv=True)`: pandas' to_csv of a frame with three column levels."""
    names = list(px)
    rows = [
        ",".join(["scorer", *[scorer] * 3 * len(names)]),
        ",".join(["bodyparts", *np.repeat(names, 3).tolist()]),
        ",".join(["coords", *COORDS * len(names)]),
    ]
    for k in range(len(px[names[0]])):
        cells = [(*px[n][k].tolist(), float(likelihood[n][k])) for n in names]
        rows.append(",".join([str(k), *("" if c != c else repr(c) for cell in cells for c in cell)]))
    path.write_text("\n".join(rows) + "\n")
    return path


def dlc_table_h5(path, px, likelihood, scorer=SCORER):
    """DeepLabCut's `analyze_videos`: to_hdf(key="df_with_missing", format="table").

    pandas.io.pytables.AppendableFrameTable: a compound dataset `table` of index and values_block_0, the columns'
    names pickled (protocol 0, as PyTables stores any object) in its attribute values_block_0_kind.
    """
    columns = [(scorer, name, coord) for name in px for coord in COORDS]
    values = np.stack([v for n in px for v in (*px[n].T, likelihood[n])], 1)
    rows = np.zeros(len(values), [("index", "<i8"), ("values_block_0", "<f8", (len(columns),))])
    rows["index"], rows["values_block_0"] = np.arange(len(values)), values
    with h5py.File(path, "w") as file:
        group = file.create_group("df_with_missing")
        group.attrs["pandas_type"] = np.bytes_(b"frame_table")
        group.attrs["table_type"] = np.bytes_(b"appendable_frame")
        group.attrs["non_index_axes"] = np.bytes_(pickle.dumps([(1, columns)], protocol=0))
        table = group.create_dataset("table", data=rows, maxshape=(None,), chunks=(1170,))
        table.attrs["values_block_0_kind"] = np.bytes_(pickle.dumps(columns, protocol=0))
        table.attrs["values_block_0_dtype"] = np.bytes_(b"float64")
    return path


def sleap_h5(path, px, score, occupied=None, tracks=("mechanism",), dims=False):
    """SLEAP's analysis file (sleap.info.write_tracking_h5): every array transposed for MATLAB, gzip 9.

    px (track, frame, node, 2) by node name; dims: as newer files (sleap-io) name the axes, here frames first.
    """
    names = list(px)
    at = np.stack([px[n] for n in names], 2)  # track, frame, node, xy
    points = np.stack([score[n] for n in names], 2)
    occupied = np.isfinite(at).all((2, 3)) if occupied is None else occupied
    with h5py.File(path, "w") as file:
        zipped = {"compression": "gzip", "compression_opts": 9}
        order = (1, 0, 2, 3) if dims else (0, 3, 2, 1)
        file.create_dataset("tracks", data=at.transpose(order), **zipped)
        file.create_dataset("point_scores", data=points.transpose((1, 0, 2) if dims else (0, 2, 1)), **zipped)
        file.create_dataset("track_occupancy", data=occupied.T.astype(np.uint8), **zipped)
        if dims:
            file["tracks"].attrs["dims"] = json.dumps(["frame", "track", "node", "xy"])
            file["point_scores"].attrs["dims"] = json.dumps(["frame", "track", "node"])
        file["node_names"] = [np.bytes_(n.encode()) for n in names]
        file["track_names"] = [np.bytes_(t.encode()) for t in tracks]
    return path


def trc_text(metres, times_s, unit="mm", per_m=1000.0):
    """A TRC file as OpenSim's documentation shows it ("Marker (.trc) Files"): six rows before the data."""
    names = list(metres)
    rate = 1 / (times_s[1] - times_s[0])
    rows = [
        "PathFileType\t4\t(X/Y/Z)\tsubject01_walk1.trc",
        "DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate\tOrigDataStartFrame\tOrigNumFrames",
        f"{rate:.2f}\t{rate:.2f}\t{len(times_s)}\t{len(names)}\t{unit}\t{rate:.2f}\t1\t{len(times_s)}",
        "Frame#\tTime\t" + "\t\t\t".join(names) + "\t\t",
        "\t\t" + "\t".join(f"X{k + 1}\tY{k + 1}\tZ{k + 1}" for k in range(len(names))) + "\t",
        "",
    ]
    for k, time_s in enumerate(times_s):
        cells = [f"{per_m * c:.5f}" if np.isfinite(c) else "" for n in names for c in metres[n][k]]
        rows.append("\t".join([str(k + 1), f"{time_s:.6f}", *cells]) + "\t")
    return "\n".join(rows) + "\n"
